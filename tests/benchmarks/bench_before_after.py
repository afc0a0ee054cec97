"""Loop, steps and updates of two checkouts of this repository, in turns in one run.

Each turn runs in a process of its own and measures processor time, which other programs disturb
less than wall time: us per answer of the control loop (the actor `fixed-speed` under the safety
layer) and per step of the simulator, us per bicycle step of the task with 1 and 128 bicycles, and
us per DDPG update at the paper's sizes with batch 64. ROS is not needed, and BEFORE needs no
set-up: actor and task run in numpy on both sides. A turn measures in slices of about 20 ms and
keeps the fastest: other programs of the machine only ever slow a slice down. Told are the fastest
of all turns, for the same reason, and after / before; the file has every turn.

    python tests/benchmarks/bench_before_after.py BEFORE [AFTER] [--turns 9] [--out FILE]

BEFORE and AFTER are folders of checkouts, of commit cb61c19 or later.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from machine import machine

HERE = Path(__file__).resolve()
RESULTS = HERE.parent / "results" / "before_after.json"
TURN = 1.0
"""Processor time of one measurement (s)."""
SLICE = 0.02
"""Processor time of one slice of a measurement (s)."""
STEPS = 5000
"""Measured steps of the loop; one slice more comes first."""
SLICE_STEPS = 100
"""Steps of the loop in one slice."""
MOVED = {
    "control_loop": ("bicycle_controller.control.control_loop", "bicycle_controller.driver"),
    "goals": ("bicycle_controller.control.goals", "bicycle_controller.goals"),
    "inference": ("bicycle_controller.policy.inference", "bicycle_controller.one_bicycle"),
    "lqr": ("bicycle_controller.control.lqr", "bicycle_controller.lqr"),
    "policy": ("bicycle_controller.policy.policy", "bicycle_controller.policy"),
    "safety": ("bicycle_controller.control.safety", "bicycle_controller.safety"),
    "scenario": ("bicycle_sim.task.scenario", "bicycle_sim.scenario"),
    "simulator": ("bicycle_sim.runtime.simulator", "bicycle_sim.simulator"),
}
"""Modules by their present and their former name."""


def module(name: str) -> ModuleType:
    """Import a module of MOVED under either name."""
    for place in MOVED[name]:
        try:
            return importlib.import_module(place)
        except ModuleNotFoundError:
            continue
    raise SystemExit(f"no {name} here")


def cost(work: Callable[[], int]) -> float:
    """Return us of processor time per unit in the fastest slice; `work` returns its units."""
    work()
    fastest, turn_begun = float("inf"), time.process_time()
    while time.process_time() - turn_begun < TURN:
        units, begun = 0, time.process_time()
        while (spent := time.process_time() - begun) < SLICE:
            units += work()
        fastest = min(fastest, spent / units)
    return 1e6 * fastest


def loop() -> dict[str, float]:
    """Ride towards a far goal; return us per answer and per step in the fastest slices."""
    control_loop, simulator = module("control_loop"), module("simulator")
    module("inference").load = lambda: None  # type: ignore[attr-defined]
    scenario = module("scenario").named("random-start-random-goal")
    ridden = simulator.Simulator(scenario)
    start = getattr(simulator, "Start", None) or simulator.InitialPose
    ridden.reset(start(0.0, 0.0, 0.4, 2.5))
    tracker = module("goals").GoalTracker()
    tracker.replace([(0.0, 4000.0)])
    kind = getattr(control_loop, "Driver", None) or control_loop.ControlLoop
    rider = kind(
        "bench",
        module("policy").load_policy("fixed-speed"),
        tracker,
        scenario.action_limits,
        fallback=module("lqr").LqrController(),
        safety=module("safety").Safety(),
    )
    spent = {"answer": 0.0, "step": 0.0}
    fastest = dict.fromkeys(spent, float("inf"))
    for number in range(STEPS + SLICE_STEPS):
        if number % SLICE_STEPS == 0:
            if number > SLICE_STEPS:
                fastest = {name: min(fastest[name], spent[name]) for name in spent}
            spent = dict.fromkeys(spent, 0.0)
        state = ridden.snapshot
        echo = (ridden.applied,) if hasattr(ridden, "applied") else ()
        begun = time.process_time()
        answer = rider.answer(state, 0.025 * state.step, *echo)
        answered = time.process_time()
        ridden.step(answer.command)
        spent["answer"] += answered - begun
        spent["step"] += time.process_time() - answered
    return {name: 1e6 * seconds / SLICE_STEPS for name, seconds in fastest.items()}


def measure() -> dict[str, float]:
    """Measure the checkout in the working directory."""
    import torch
    from bench_updates import ours, transitions
    from bicycles import batched

    torch.set_num_threads(1)
    found = loop()
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
        "import importlib.util, json, sys; sys.path.insert(0, 'tests/benchmarks'); "
        f"spec = importlib.util.spec_from_file_location('before_after', {str(HERE)!r}); "
        "module = importlib.util.module_from_spec(spec); spec.loader.exec_module(module); "
        "print('RESULT', json.dumps(module.measure()))"
    )
    places = [checkout, checkout / "ros2_ws" / "src"]
    packages = [folder for place in places for folder in sorted(place.glob("bicycle_*"))]
    env = {name: os.environ[name] for name in ("HOME", "PATH") if name in os.environ}
    env |= {"PYTHONPATH": ":".join(map(str, packages)), "OMP_NUM_THREADS": "1"}
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, cwd=checkout, env=env, capture_output=True, text=True)
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
    parser.add_argument("--turns", type=int, default=9)
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    sides = {"before": args.before.resolve(), "after": args.after.resolve()}
    turns: dict[str, list[dict[str, float]]] = {side: [] for side in sides}
    for number in range(args.turns):
        for side in list(sides)[:: -1 if number % 2 else 1]:
            turns[side].append(turn_of(sides[side]))
    fastest = {
        side: {name: min(one[name] for one in rows) for name in rows[0]}
        for side, rows in turns.items()
    }
    ratios = {
        name: round(fastest["after"][name] / value, 3) for name, value in fastest["before"].items()
    }
    result = {
        "command": f"python tests/benchmarks/{HERE.name} BEFORE --turns {args.turns}",
        **machine("numpy", "torch"),
        "commits": {side: commit(folder) for side, folder in sides.items()},
        "unit": "us of processor time in the fastest slice of all turns",
        **{
            side: {name: round(value, 2) for name, value in fastest[side].items()}
            for side in sides
        },
        "after / before": ratios,
        "turns": {
            side: [{name: round(value, 2) for name, value in one.items()} for one in rows]
            for side, rows in turns.items()
        },
    }
    args.out.write_text(json.dumps(result, indent=1) + "\n")
    print(json.dumps(ratios, indent=1))


if __name__ == "__main__":
    main()
