"""Limits of the shipped actors: rides under delay, at other speeds, with kicks and noise.

Each actor rides in the scenario that it was trained on, from the same random starts to the same
random goals, in numpy and without ROS; beside it rides the LQR that may use the same actions and
sees the speed besides. Each ride is what `bicycle evaluate` rides with the options of its row.

    python tests/benchmarks/bench_limits.py [--rides 1000] [--out FILE]
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
from bicycle_controller.policy.policy import load_controller
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
    found = evaluate(
        load_controller(controller, physics),
        named(scenario),
        physics,
        rides,
        SEED,
        Disturbance(**options),
    ).summary()
    return {name: found[name] for name in KEPT}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rides", type=int, default=1000)
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    result: dict[str, Any] = {
        **origin(),
        "machine": machine("numpy"),
        "seed": SEED,
        "rides": args.rides,
        "actors": {
            actor: {
                "policy": load_controller(actor).policy_id,
                "scenario": scenario,
                "lqr": lqr,
            }
            for actor, (scenario, lqr) in ACTORS.items()
        },
        "conditions": {},
    }
    known: dict[tuple[str, str, str], dict[str, Any]] = {}
    with tqdm(total=len(CONDITIONS) * len(ACTORS) * 2, unit="part") as bar:
        for name, condition in CONDITIONS.items():
            row = result["conditions"].setdefault(name, {})
            for actor, (scenario, lqr) in ACTORS.items():
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
