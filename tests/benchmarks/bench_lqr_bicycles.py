r"""Goals and largest kicks of measured bicycles by their LQRs, and kicks by `any-bicycle`.

    python tests/benchmarks/bench_lqr_bicycles.py

Goals: rides of the scenario random-start-random-goal. Kicks: `evaluation.kicks.largest`, with a
motor of 7 N m, by `lqr`, by the best LQR of the grid for that very bicycle,
delay and speed, and by a network. Writes `docs/results/bicycles/lqr.json` after each row.

    python tests/benchmarks/bench_lqr_bicycles.py --parts kicks --network sure-any-bicycle \
        --yardstick docs/results/bicycles/lqr.json --out docs/results/sure-any-bicycle/kicks.json

kicks another network, beside what the regulators caught in an earlier result.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from machine import machine

from bicycle_common.origin import made_by
from bicycle_controller.control.controller import Controller
from bicycle_controller.control.lqr import LqrController
from bicycle_controller.evaluation.evaluate import evaluate
from bicycle_controller.evaluation.kicks import SPEEDS, largest
from bicycle_controller.evaluation.lqr_grid import best
from bicycle_controller.policy.policy import load_controller, load_policy
from bicycle_sim.plants import registry
from bicycle_sim.plants.whipple import catalogue
from bicycle_sim.plants.whipple.parameters import Motor
from bicycle_sim.task.scenario import named

OUT = Path(__file__).parents[2] / "docs" / "results" / "bicycles" / "lqr.json"
TO_GOALS = ("browser-rider", "benchmark", "steer-by-wire", "balance-assist-rider")
GOAL_SPEEDS = (2.0, 2.78, 5.0)
KICKED = (
    *(("browser-rider", delay, 0.03) for delay in (0.025, 0.05, 0.075)),
    *(("steer-by-wire", delay, 0.03) for delay in (0.025, 0.05, 0.075)),
    ("browser-rider", 0.025, 0.0),
)
"""Bicycle, s of delay, s of the motor's lag."""
LIMIT = 7.0
"""N m of the motor."""
PARTS = ("kicks", "goals")
REGULATORS = ("lqr", "best of the grid")


def kicks(network: str, yardstick: Path | None) -> Iterator[dict[str, Any]]:
    """Yield the kicks caught by each controller, deg/s: the smallest of four, and straight on.

    Args:
        network: name or file of a policy.
        yardstick: an earlier result with those of the regulators; None to kick them anew.
    """
    known = [] if yardstick is None else json.loads(yardstick.read_text())["kicks"]
    for bicycle, delay, lag in KICKED:
        own = catalogue.load(bicycle).parameters
        own = replace(own, delay=delay, motor=Motor(lag=lag, limit=LIMIT))
        plant = registry.PLANTS["whipple"](own)
        limits = (LIMIT, 0.0, 0.0)
        name = load_policy(network).name
        riders: dict[str, Controller] = {name: load_controller(network, plant)}
        if yardstick is None:
            riders["lqr"] = LqrController.named("lqr", plant)
        for speed in SPEEDS:
            cell = {
                "bicycle": bicycle,
                "delay (s)": delay,
                "motor lag (s)": lag,
                "speed (m/s)": speed,
            }
            found = {who: largest(rider, plant, speed, limits) for who, rider in riders.items()}
            if yardstick is None:
                found["best of the grid"] = best(plant, speed, limits).kicks
            caught = {who: one.caught for who, one in found.items()}
            straight = {who: min(one.straight) for who, one in found.items()}
            for row in known:
                if cell.items() <= row.items():
                    caught |= {who: row["caught"][who] for who in REGULATORS}
                    straight |= {who: row["straight"][who] for who in REGULATORS}
            yield cell | {"caught": caught, "straight": straight}


def goals(rides: int, seed: int) -> Iterator[dict[str, Any]]:
    """Yield how many goals the LQR of each bicycle reaches."""
    for bicycle in TO_GOALS:
        plant = registry.named("whipple", bicycle)
        scenario = named("random-start-random-goal").with_motor(plant.torque_limit)
        scenario = scenario.suited(plant.input_names)
        who = LqrController.named("lqr", plant, scenario.torque_limit)
        for speed in GOAL_SPEEDS:
            ridden = replace(scenario, start_speed=speed, speed_limits=None)
            found = evaluate(who, ridden, plant, rides, seed).summary()
            keys = ("reach_rate", "reach_rate_interval", "fall_rate", "orbit_rate")
            row = {key: found[key] for key in keys}
            yield {"bicycle": bicycle, "speed (m/s)": speed, **row}


def main() -> None:
    """Measure, and write after each row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rides", type=int, default=1000, help="to goals, of each bicycle")
    parser.add_argument("--seed", type=int, default=0, help="of starts and goals")
    parser.add_argument("--parts", nargs="+", default=PARTS, choices=PARTS)
    parser.add_argument("--network", default="any-bicycle", help="kicked beside the regulators")
    parser.add_argument("--yardstick", type=Path, help="a result, for the regulators' kicks")
    parser.add_argument("--out", type=Path, default=OUT)
    given = parser.parse_args()
    result: dict[str, Any] = {**made_by(), "machine": machine("numpy"), "seed": given.seed}
    if "kicks" in given.parts:
        result["network"] = load_policy(given.network).policy_id
    given.out.parent.mkdir(parents=True, exist_ok=True)
    for part in given.parts:
        rows = goals(given.rides, given.seed)
        for row in kicks(given.network, given.yardstick) if part == "kicks" else rows:
            result.setdefault(part, []).append(row)
            given.out.write_text(json.dumps(result, indent=1) + "\n")
            print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
