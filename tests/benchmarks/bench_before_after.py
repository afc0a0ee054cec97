"""Loop, steps and updates of two checkouts of this repository, in turns in one run.

Each turn runs in a process of its own with the checkout's environment and measures processor
time, which other programs disturb less than wall time: us per step of simulator and controller in
lock-step, us per bicycle step of the task with 1 and 128 bicycles in numpy, and us per DDPG update
at the paper's sizes with batch 64. Told are the medians over the turns, and after / before.

    python tests/benchmarks/bench_before_after.py BEFORE [AFTER] [--turns 3] [--out FILE]

BEFORE and AFTER are folders of checkouts after their `ros2_ws/setup.sh --with dev`.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from machine import machine

HERE = Path(__file__).resolve()
RESULTS = HERE.parent / "results" / "before_after.json"
TURN = 1.0
"""Processor time of one measurement (s)."""
RIDE = 6.0
"""Length of a ride in lock-step (s)."""


def cost(work: Callable[[], int]) -> float:
    """Return us of processor time per unit; `work` returns the number of units that it did."""
    work()
    units, begun = 0, time.process_time()
    while (spent := time.process_time() - begun) < TURN:
        units += work()
    return 1e6 * spent / units


def measure() -> dict[str, float]:
    """Measure the checkout whose environment this process has."""
    import torch
    from bench_executor import KINDS, turn
    from bench_updates import ours, transitions
    from bicycles import batched

    torch.set_num_threads(1)
    found = {
        name.removesuffix("_us_per_step"): value
        for name, value in turn(KINDS[0], RIDE).items()
        if name.endswith("_us_per_step")
    }
    for count in (1, 128):
        step = batched(count)

        def steps(step: Callable[[], None] = step, count: int = count) -> int:
            for _ in range(20):
                step()
            return 20 * count

        found[f"task, {count}"] = cost(steps)
    update = ours("native", 64, transitions())

    def updates() -> int:
        update(20)
        return 20

    found["update"] = cost(updates)
    return found


def turn_of(checkout: Path) -> dict[str, float]:
    """Run `measure` in a checkout."""
    code = (
        "import importlib.util, json, sys; sys.path[:0] = ['tests/benchmarks', 'tests/support']; "
        f"spec = importlib.util.spec_from_file_location('before_after', {str(HERE)!r}); "
        "module = importlib.util.module_from_spec(spec); spec.loader.exec_module(module); "
        "print('RESULT', json.dumps(module.measure()))"
    )
    words = ["bash", "-c", 'set -e; . ros2_ws/env.sh; exec python -c "$0"', code]
    keep = ("HOME", "PATH", "LANG", "ROS_DOMAIN_ID")
    clean = {name: os.environ[name] for name in keep if name in os.environ}
    done = subprocess.run(words, cwd=checkout, env=clean, capture_output=True, text=True)
    for line in done.stdout.splitlines():
        if line.startswith("RESULT "):
            found: dict[str, float] = json.loads(line.partition(" ")[2])
            return found
    sys.exit(f"{checkout}: {done.stderr.strip().splitlines()[-1:]}")


def commit(checkout: Path) -> str:
    """Return the commit of a checkout."""
    words = ["git", "-C", str(checkout), "rev-parse", "--short", "HEAD"]
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()


def main() -> None:
    """Run, print and write the results."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path, nargs="?", default=HERE.parents[2])
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    sides = {"before": args.before, "after": args.after}
    turns: dict[str, list[dict[str, float]]] = {side: [] for side in sides}
    for number in range(args.turns):
        for side in list(sides)[:: -1 if number % 2 else 1]:
            turns[side].append(turn_of(sides[side]))
    medians = {
        side: {name: statistics.median(one[name] for one in rows) for name in rows[0]}
        for side, rows in turns.items()
    }
    result = {
        **machine("numpy", "torch"),
        "commits": {side: commit(folder) for side, folder in sides.items()},
        "unit": "us of processor time",
        "turns": turns,
        **{
            side: {name: round(value, 2) for name, value in medians[side].items()}
            for side in sides
        },
        "after / before": {
            name: round(medians["after"][name] / value, 3)
            for name, value in medians["before"].items()
        },
    }
    args.out.write_text(json.dumps(result, indent=1) + "\n")
    print(json.dumps(result["after / before"], indent=1))


if __name__ == "__main__":
    main()
