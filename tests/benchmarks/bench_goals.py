"""CPU time until a learner rides to 99 % of 1,000 random goals: ours and competent peers.

One task for all: 10 km/h, displacement up to 20 cm, any start, goal and heading, faithful physics.

    fast          the preset `fast`, from nothing, no teacher
    quick         the preset `quick`: fast with smaller critics and batches, three updates a step
    all others    stable-baselines3, sb3-contrib and SBX, see `peers.py`; compiling included

Time is that of the processor, for learning and collecting; scoring is left out for all. All are
scored at the same points, after 0.3 s and then whenever a tenth more is spent: by 20 goals, by 100
from 80 % on, and by the 1,000 from 97 % on. Seeds take turns, and within a seed the learners, so
that other work on the machine falls on all of them. A run is added to the file as soon as it ends;
runs that are there already are not repeated. A run ends at 99 %, or at its first score after the
limit: it has not reached them then.

    python tests/benchmarks/bench_goals.py [--only fast ppo ...] [--seeds 1 2 3] [--limit 120]
"""

from __future__ import annotations

import argparse
import json
import shlex
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from machine import machine
from peers import PEERS, SCENARIO, PeerController, model_of

from bicycle_controller.config import loading
from bicycle_controller.evaluation.evaluate import evaluate
from bicycle_controller.training import online
from bicycle_controller.training.run_folder import RunFolder, origin
from bicycle_sim.task.scenario import named

RESULTS = Path(__file__).parent / "results" / "goals.json"
WANTED = 0.99
SCORED = {20: 0.8, 100: 0.97, 1000: WANTED}
"""Goals of each score, and the share of them from which the next score is taken."""
SEED = 77
"""Seed of the scored goals, the same for all."""
FIRST, APART = 0.3, 0.1
"""s of processor time until the first score, and the share of it between two scores."""
OURS = ("fast", "quick")

Row = dict[str, Any]


def reach_rate(controller: Any) -> tuple[float, int]:
    """Share of the scored goals that it rides to, and their number."""
    for goals, wanted in SCORED.items():
        found = evaluate(controller, named(SCENARIO), episodes=goals, seed=SEED).summary()
        rate = float(found["reach_rate"])
        if rate < wanted:
            break
    return rate, goals


class Clock:
    """Processor time of learning, and a score whenever a tenth more is spent."""

    def __init__(self, controller: Callable[[], Any], limit: float) -> None:
        """Start; stop after `limit` s."""
        self.controller, self.limit = controller, limit
        self.spent, self.next, self.begun = 0.0, FIRST, time.process_time()
        self.curve: list[Row] = []

    def goes_on(self, steps: int, updates: int) -> bool:
        """Score if it is time; return False at 99 % or at the limit."""
        spent = self.spent + time.process_time() - self.begun
        if spent < self.next:
            return True
        rate, goals = reach_rate(self.controller())
        self.curve.append(
            {"cpu_s": spent, "steps": steps, "updates": updates, "rate": rate, "goals": goals}
        )
        self.spent, self.next = spent, (1.0 + APART) * spent
        self.begun = time.process_time()
        return not (goals == 1000 and rate >= WANTED) and spent < self.limit


def ours(name: str, seed: int, limit: float) -> list[Row]:
    """One run of a preset of ours."""
    changes = (f"seed={seed}", f"scenario={SCENARIO}", "evaluation.every=1000000")
    small = ("evaluation.episodes=1", "evaluation.near_episodes=0", "tensorboard=false")
    config = loading.preset(name, [*changes, *small])
    with tempfile.TemporaryDirectory() as folder:
        files = RunFolder(Path(folder) / "run")
        files.create(config)
        learner = online.Trainer(config, files)
        clock = Clock(learner.policy, limit)

        def stop() -> bool:
            return not clock.goes_on(learner.collector.steps, learner.updates)

        learner.train(progress=False, stop=stop)
    return clock.curve


def peer(name: str, seed: int, limit: float) -> list[Row]:
    """One run of a peer."""
    from stable_baselines3.common.callbacks import BaseCallback

    model = model_of(name, seed)
    clock = Clock(lambda: PeerController(model, tuple(SCORED)), limit)

    class Score(BaseCallback):
        def _on_step(self) -> bool:
            return clock.goes_on(self.num_timesteps, self.model._n_updates)

    model.learn(10**9, callback=Score())
    return clock.curve


def summary(runs: dict[str, dict[str, list[Row]]]) -> dict[str, Any]:
    """Medians over seeds, for those that reached 99 % and for all."""
    found: dict[str, Any] = {}
    for name, curves in runs.items():
        ends = [curve[-1] for curve in curves.values()]
        reached = [row["goals"] == 1000 and row["rate"] >= WANTED for row in ends]
        found[name] = {
            "seeds": len(ends),
            "reached 99 %": sum(reached),
            "cpu_s": statistics.median(row["cpu_s"] for row in ends),
            "cpu_s of each": [round(row["cpu_s"], 1) for row in ends],
            "steps": statistics.median(row["steps"] for row in ends),
            "updates": statistics.median(row["updates"] for row in ends),
            "last rate of each": [row["rate"] for row in ends],
        }
    for mine in set(OURS) & set(found):
        for row in found.values():
            row[f"times {mine}"] = round(row["cpu_s"] / found[mine]["cpu_s"], 2)
    return found


def main() -> None:
    """Run, and write the results after each run."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3, 4, 5])
    parser.add_argument("--peer-seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--limit", type=float, default=120.0, help="s of processor time of a run")
    parser.add_argument("--only", nargs="+", choices=(*OURS, *PEERS), default=[*OURS, *PEERS])
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    torch.set_num_threads(1)
    old = json.loads(args.out.read_text()) if args.out.exists() else {}
    runs: dict[str, dict[str, list[Row]]] = old.get("runs", {})
    about = {"command": shlex.join(["python", *sys.argv]), "commit": origin()["commit"]}
    packages = ("numpy", "torch", "gymnasium", "stable-baselines3", "sb3-contrib", "sbx-rl")
    about["machine"] = machine(*packages)
    commands = [*old.get("commands", []), about]
    for seed in sorted({*args.seeds, *args.peer_seeds}):
        for name in args.only:
            mine = name in OURS
            done = runs.setdefault(name, {})
            if str(seed) in done or seed not in (args.seeds if mine else args.peer_seeds):
                continue
            done[str(seed)] = (
                ours(name, seed, args.limit) if mine else peer(name, seed, args.limit)
            )
            print(f"{name} seed {seed}: {done[str(seed)][-1]}", flush=True)
            found = {name: curves for name, curves in runs.items() if curves}
            result = {"wanted": WANTED, "summary": summary(found), "commands": commands}
            args.out.write_text(json.dumps(result | {"runs": found}, indent=1) + "\n")
    print(json.dumps(summary({n: c for n, c in runs.items() if c}), indent=2))


if __name__ == "__main__":
    main()
