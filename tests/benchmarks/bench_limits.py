"""Limits of the shipped actors: rides under delay, at other speeds, with kicks and noise.

Each actor rides in the scenario that it was trained on, from the same random starts to the same
random goals, in numpy and without ROS; beside it rides the LQR that may use the same actions and
sees the speed besides. Each ride is what `bicycle evaluate` rides with the options of its row.

    python tests/benchmarks/bench_limits.py [--rides 1000] [--actors NAME...] [--out FILE]

Actors may be others than the shipped ones: `runs/mine=learned-speed` names a run and its scenario.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from machine import machine
from tqdm import tqdm

from bicycle_controller.evaluation.evaluate import evaluate
from bicycle_controller.evaluation.rollouts import Disturbance
from bicycle_controller.evaluation.score import near
from bicycle_controller.policy.policy import load_controller, load_policy
from bicycle_controller.training.run_folder import origin
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import named

RESULTS = Path(__file__).parent / "results" / "limits.json"
SEED = 7
ACTORS = {
    "fixed-speed": ("random-start-random-goal", "lqr-20cm"),
    "naf": ("random-start-random-goal", "lqr-20cm"),
    "ppo": ("random-start-random-goal", "lqr-20cm"),
    "small-displacement": ("random-small-displacement", "lqr-displacement"),
    "learned-speed": ("learned-speed", "lqr-displacement-pedal"),
}
LQRS = {
    "random-start-random-goal": "lqr-20cm",
    "random-small-displacement": "lqr-displacement",
    "learned-speed": "lqr-displacement-pedal",
}
"""Shipped actors, the scenario that each rides in, and the LQR that it is compared with."""
CONDITIONS: dict[str, dict[str, Any]] = {
    "as trained": {},
    **{f"--action-delay {steps}": {"action_delay": steps} for steps in (1, 2, 3, 4, 5)},
    **{f"--speed {speed:g}": {"speed": speed} for speed in (1.0, 1.5, 2.0, 2.5, 3.5, 4.0, 5.0)},
    **{f"--roll-kick {kick:g}": {"roll_kick": kick} for kick in (0.2, 0.35, 0.5, 0.75, 1.0)},
    **{
        f"--observation-noise {noise:g}": {"observation_noise": (noise,) * 6}
        for noise in (0.02, 0.05, 0.1, 0.2)
    },
    "--physics corrected": {"physics": "corrected"},
}
MORE: dict[str, dict[str, Any]] = {
    **{
        f"--roll-kick {kick}{too}": {"roll_kick": kick, **physics}
        for kick in (0.5236, 0.6981)
        for too, physics in (("", {}), (" --physics corrected", {"physics": "corrected"}))
    },
    **{
        f"--physics corrected --action-delay {steps}": {
            "physics": "corrected",
            "action_delay": steps,
        }
        for steps in (3, 4)
    },
    **{
        f"goals within 15 m, {speed:g} m/s": {"near": True, "speed": speed}
        for speed in (1.0, 2.0, 2.7778, 4.0, 5.0)
    },
    "goals within 15 m --physics corrected": {"near": True, "physics": "corrected"},
}
"""Further rows for `--more`: 30 and 40 degrees/s, and goals that may lie beside the bicycle."""
NEAR = 10.6
"""Half width of the square of near goals, m."""
"""Options of `bicycle evaluate`, and what they are; a step of delay is 25 ms."""
KEPT = (
    "reach_rate",
    "reach_rate_interval",
    "fall_rate",
    "fall_rate_interval",
    "timeout_rate",
    "orbit_rate",
    "median_time_s",
)


def ride(controller: str, scenario: str, condition: dict[str, Any], rides: int) -> dict[str, Any]:
    """Evaluate one controller under one condition."""
    options = dict(condition)
    physics = ChoiPlant.named(options.pop("physics", "faithful"))
    task = named(scenario)
    found = evaluate(
        load_controller(controller, physics),
        near(task, NEAR) if options.pop("near", False) else task,
        physics,
        rides,
        SEED,
        Disturbance(**options),
    ).summary()
    return {name: found[name] for name in KEPT}


def lqr_rows(file: Path, rides: int) -> dict[tuple[str, str, str], dict[str, Any]]:
    """Return the LQRs' rows of an earlier result of as many rides, by condition and scenario."""
    result = json.loads(file.read_text())
    if (result["seed"], result["rides"]) != (SEED, rides):
        raise SystemExit(
            f"{file} holds {result['rides']} rides of seed {result['seed']}: ride anew"
        )
    rows = (
        (condition, *rider.split(" in "), found)
        for condition, row in result["conditions"].items()
        for rider, found in row.items()
    )
    return {
        (condition, scenario, controller): found
        for condition, controller, scenario, found in rows
        if controller == LQRS.get(scenario)
    }


def chosen(text: str) -> tuple[str, tuple[str, str]]:
    """Return an actor, its scenario and the LQR beside it, of `NAME` or `NAME=SCENARIO`."""
    name, _, scenario = text.partition("=")
    if not scenario:
        scenario = ACTORS[name][0] if name in ACTORS else load_policy(name).info.scenario.name
    return name, (scenario, LQRS[scenario])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rides", type=int, default=1000)
    parser.add_argument("--actors", nargs="+", metavar="NAME[=SCENARIO]", default=list(ACTORS))
    parser.add_argument(
        "--lqrs",
        type=Path,
        nargs="+",
        default=[],
        metavar="FILE",
        help="take the LQRs' rows from earlier results",
    )
    parser.add_argument("--more", action="store_true", help="ride the rows of MORE, too")
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    actors = dict(chosen(text) for text in args.actors)
    conditions = CONDITIONS | (MORE if args.more else {})
    result: dict[str, Any] = {
        **origin(),
        "lqrs_from": [file.name for file in args.lqrs],
        "machine": machine("numpy"),
        "seed": SEED,
        "rides": args.rides,
        "actors": {
            actor: {
                "policy": load_controller(actor).policy_id,
                "scenario": scenario,
                "lqr": lqr,
            }
            for actor, (scenario, lqr) in actors.items()
        },
        "conditions": {},
    }
    known = {k: v for file in args.lqrs for k, v in lqr_rows(file, args.rides).items()}
    with tqdm(total=len(conditions) * len(actors) * 2, unit="part") as bar:
        for name, condition in conditions.items():
            row = result["conditions"].setdefault(name, {})
            for actor, (scenario, lqr) in actors.items():
                for controller in (actor, lqr):
                    key = (name, scenario, controller)
                    if key not in known:
                        known[key] = ride(controller, scenario, condition, args.rides)
                    row[f"{controller} in {scenario}"] = known[key]
                    bar.update()
            args.out.write_text(json.dumps(result, indent=1) + "\n")
    for name, row in result["conditions"].items():
        for rider, found in row.items():
            print(f"{name:26} {rider:55} {found['reach_rate']:7.3f} {found['fall_rate']:7.3f}")


if __name__ == "__main__":
    main()
