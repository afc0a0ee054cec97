"""Every shipped controller on the paper's bicycle, Whipple's and MuJoCo's: `second_opinion.json`.

Goals, falls and the largest kick caught, from the same starts. The paper's actors were trained on
the paper's bicycle alone, and none ever rode in MuJoCo.
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from machine import machine

from bicycle_controller.evaluation.evaluate import evaluate
from bicycle_controller.evaluation.kicks import Trial, largest
from bicycle_controller.policy.policy import load_controller, shipped_policies
from bicycle_controller.training.run_folder import origin
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant
from bicycle_sim.plants.whipple import catalogue
from bicycle_sim.plants.whipple.parameters import Motor
from bicycle_sim.task.scenario import Region, named

OUT = Path(__file__).parent / "results" / "second_opinion.json"
BICYCLE, SPEED, LIMIT = "browser-rider", 10.0 / 3.6, 7.0
"""Riding bicycle, m/s, N m of its motor."""
FIELD = Region((0.0, 0.0), (60.0, 60.0))
"""m, of starts and goals."""
TRIAL = Trial(most=200.0, coarse=10.0, fine=2.0, before=4.0, after=4.0)


def plants() -> dict[str, Plant[Any]]:
    """Return the three plants."""
    known = replace(catalogue.load(BICYCLE).parameters, motor=Motor(limit=LIMIT))
    plants = {name: registry.PLANTS[name](known) for name in ("whipple", "mujoco")}
    return {"paper": registry.default(), **plants}


def row(name: str, plant: Plant[Any], rides: int) -> dict[str, Any]:
    """Return goals, falls and kicks of one controller on one plant."""
    scenario = named("random-start-random-goal").with_motor(plant.torque_limit)
    controller = load_controller(name, plant)
    info = getattr(controller, "info", None)
    if info is not None:
        limits = info.action_limits
        scenario = replace(scenario, displacement_limit=limits[1], pedal_limit=limits[2])
    scenario = replace(scenario, start=FIELD, goal=FIELD, start_speed=SPEED, max_steps=2000)
    scenario = scenario.suited(plant.input_names)
    found = evaluate(controller, scenario, plant, rides, seed=0).summary()
    kicks = largest(controller, plant, SPEED, scenario.action_limits, TRIAL)
    keys = ("reach_rate", "fall_rate", "fall_rate_interval", "orbit_rate", "median_time_s")
    return {key: found[key] for key in keys} | {"kicks": kicks.summary()}


def main() -> None:
    """Measure, print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rides", type=int, default=200)
    parser.add_argument(
        "--controllers", nargs="+", help="these alone; the other rows are kept (default: all)"
    )
    args = parser.parse_args()
    known = json.loads(OUT.read_text()) if args.controllers else {}
    rows: dict[str, Any] = known.get("rows", {})
    earlier = known.get("made", [])
    ridden = plants()
    print("| controller | " + " | ".join(ridden) + " |")
    for name in args.controllers or ("lqr", *shipped_policies()):
        cells = []
        for kind, plant in ridden.items():
            try:
                one = row(name, plant, args.rides)
            except ValueError as error:
                cells.append(f"- ({error})")
                continue
            rows[f"{name}, {kind}"] = one
            reach, fall = 100.0 * one["reach_rate"], 100.0 * one["fall_rate"]
            straight, caught = one["kicks"]["straight"], one["kicks"]["caught"]
            cells.append(f"{reach:.1f}, {fall:.1f} %; {min(straight):g}, {caught:g}")
        print(f"| `{name}` | {' | '.join(cells)} |", flush=True)
    about = {
        "command": shlex.join(["python", *sys.argv]),
        "commit": origin()["commit"],
        "machine": machine("numpy", "mujoco"),
        "rides": args.rides,
    }
    before = earlier or ([{key: known[key] for key in about}] if known else [])
    result = about | {"rows": rows, "made": [*before, about]}
    OUT.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
