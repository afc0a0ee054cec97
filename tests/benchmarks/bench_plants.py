"""Steps per second of the Whipple bicycle beside the paper's.

Each turn steps N bicycles, pushed and under random torques. `choi` is the paper's bicycle in
numpy; `whipple` is compiled, with 2 substeps (for learning) and 10 (for riding), its bicycles all
alike or each different, with everything bolted to them, and with a leaning rider. In turns, so
that ratios hold on a machine that does other things; rates are per second of processor time.

    python tests/benchmarks/bench_plants.py [--turns 7] [--out FILE]
"""

from __future__ import annotations

import argparse
import json
import shlex
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from machine import machine
from tqdm import tqdm

from bicycle_controller.training.run_folder import origin
from bicycle_sim.plants.base import Plant
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.plants.whipple import catalogue
from bicycle_sim.plants.whipple.parameters import (
    Bicycle,
    Motor,
    Parameters,
    Resistance,
    Road,
    Steering,
)
from bicycle_sim.plants.whipple.plant import WhipplePlant

RESULTS = Path(__file__).parent / "results" / "plants.json"
SIZES = (1, 64, 256, 1024, 4096)
TURN = 0.3
"""s of processor time that a turn lasts."""


def plants(count: int) -> dict[str, Plant[Any]]:
    """Return the contestants for `count` bicycles."""
    benchmark = catalogue.load("benchmark").parameters
    rng = np.random.default_rng(0)
    different = Bicycle(
        **{
            name: value * rng.uniform(0.95, 1.05, count)
            for name, value in vars(benchmark.bicycle).items()
        }
    )
    full = Parameters(
        different,
        steering=Steering(friction=0.2, damping=0.1),
        motor=Motor(limit=7.0, lag=0.02),
        resistance=Resistance(drag_area=0.5, side_area=0.8, rolling=0.005),
        road=Road(grade_x=0.01),
        delay=0.03,
        substeps=2,
    )
    leaning = replace(catalogue.load("browser-leaning-rider").parameters, substeps=2)
    return {
        "choi": ChoiPlant(),
        "whipple, 2 substeps": WhipplePlant(replace(benchmark, substeps=2)),
        "whipple, 10 substeps": WhipplePlant(benchmark),
        "whipple, 2 substeps, all different": WhipplePlant(Parameters(different, substeps=2)),
        "whipple, 2 substeps, everything": WhipplePlant(full),
        "whipple, 2 substeps, leaning rider": WhipplePlant(leaning),
    }


def stepper(plant: Plant[Any], count: int) -> Callable[[], None]:
    """Step the same state again and again."""
    zero = np.zeros(count)
    state = plant.pushed(plant.initial(zero, zero, zero, zero + 4.6), 0.1)
    torque = 0.1 * np.random.default_rng(0).normal(size=count)

    def step() -> None:
        plant.step(state, torque, zero, zero)

    return step


def rate(step: Callable[[], None], count: int) -> float:
    """Bicycle steps per second of processor time, over one turn."""
    rounds, begun = 0, time.process_time()
    while (spent := time.process_time() - begun) < TURN:
        step()
        rounds += 1
    return count * rounds / spent


def main() -> None:
    """Run, print and write the results."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--turns", type=int, default=7)
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    contestants = {
        (name, count): stepper(plant, count)
        for count in SIZES
        for name, plant in plants(count).items()
    }
    rates: dict[tuple[str, int], list[float]] = {key: [] for key in contestants}
    for _ in tqdm(range(args.turns), unit="turn", disable=None):
        for key, step in contestants.items():
            rates[key].append(rate(step, key[1]))
    medians = {key: statistics.median(found) for key, found in rates.items()}
    ratios = {
        f"{name}, {count}": statistics.median(
            one / other for one, other in zip(found, rates["choi", count], strict=True)
        )
        for (name, count), found in rates.items()
        if name != "choi"
    }
    library = WhipplePlant(catalogue.load("benchmark").parameters)._library
    result = {
        "command": shlex.join(["python", *sys.argv]),
        "commit": origin()["commit"],
        "machine": machine("numpy"),
        "instructions": {None: "numpy", 0: "SSE2", 1: "AVX2", 2: "AVX-512"}[
            None if library is None else library.width
        ],
        "steps_per_cpu_s": {f"{name}, {count}": value for (name, count), value in medians.items()},
        "over choi, median of the turns": ratios,
        "turns": args.turns,
    }
    args.out.write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
