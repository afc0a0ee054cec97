"""Learning from recorded rides alone: plain DDPG, TD3+BC and mere imitation.

Makes an hour of riding: the LQR with Ornstein-Uhlenbeck noise of four sizes, a quarter of an hour
each, by the nodes' own loop, driver, conversion and bag writer without DDS between them. Every
learner then gets all of it (`hour`), the quarter with noise of 0.1 (`quarter`), or the one with
noise of 0.05, in which nobody falls (`timid`), and the same number of updates; the actor that
the run keeps rides 1,000 random pairs of start and goal, and then for half a minute with noise
of 0.1, as when it explores. Imitation gets the first seed only.
What is in the work folder already is not made again.

    python tests/benchmarks/bench_learn.py --work FOLDER [--seeds 1 2 3] [--only TEXT] [--out FILE]
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from machine import machine
from tqdm import tqdm

from bicycle_controller.training.run_folder import origin

RESULTS = Path(__file__).parent / "results" / "learn.json"
SIGMAS = (0.05, 0.1, 0.15, 0.2)
STEPS = 36_000
"""A quarter of an hour."""
FIRST_SEED = 200
"""Seed of the first bag; each further bag adds 1."""
DATA = {"hour": "bags", "quarter": "bags/bag-0.1", "timid": "bags/bag-0.05"}
LEARNERS = {
    "plain": ("offline-plain",),
    "td3+bc 2.5": ("offline", "ddpg.bc_alpha=2.5"),
    "td3+bc 1": ("offline", "ddpg.bc_alpha=1"),
    "td3+bc 0.5": ("offline", "ddpg.bc_alpha=0.5"),
    "imitation": ("offline", "ddpg.bc_weight=1000"),
}
BUDGET = ("--updates", "8000")
LOOKS = ("every=1000", "episodes=128", "near_episodes=128", "shake=0.1")


def record(folder: Path) -> None:
    """Make the bags that are not there."""
    from ride_bag_maker import Rider, write_bag

    for index, sigma in enumerate(SIGMAS):
        path = folder / f"bag-{sigma}"
        if not (path / "metadata.yaml").exists():
            rider = Rider(sigma=sigma, seed=FIRST_SEED + index)
            write_bag(path, tqdm(rider.ride(STEPS), desc=path.name, unit="message"))


def bicycle(*words: object) -> dict[str, Any]:
    """Return the output of a command with --json; a failed one has kept nothing."""
    command = [
        sys.executable,
        "-m",
        "bicycle_controller.cli.main",
        *map(str, words),
        "--json",
        "--quiet",
    ]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    if not done.stdout:
        sys.exit(f"failed: {' '.join(command)}")
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def learn(work: Path, data: str, learner: str, seed: int) -> dict[str, Any]:
    """Make one run, or what it came to before."""
    folder = work / "runs" / f"{data}-{learner.replace(' ', '-')}-{seed}"
    files = {name: folder / f"{name}.json" for name in ("learn", "evaluate")}
    if not files["evaluate"].exists():
        folder.mkdir(parents=True, exist_ok=True)
        preset, *changes = LEARNERS[learner]
        changes += ["tensorboard=false", *(f"evaluation.{look}" for look in LOOKS)]
        words = [word for change in changes for word in ("--set", change)]
        run = folder / "run"
        found = bicycle(
            *("learn", work / DATA[data], "--out", run, "--preset", preset),
            *("--seed", seed, *BUDGET, *words),
        )
        files["learn"].write_text(json.dumps(found))
        files["evaluate"].write_text(json.dumps(bicycle("evaluate", run, "--episodes", 1000)))
    learned, ridden = (json.loads(path.read_text()) for path in files.values())
    log = [json.loads(line) for line in (folder / "run" / "log.jsonl").read_text().splitlines()]
    looks = [row for row in log if row["kind"] == "evaluation"]
    good = [row["updates"] for row in looks if row["reach_rate"] >= 0.95]
    names = ("reach_rate", "reach_rate_interval", "fall_rate", "orbit_rate", "median_time_s")
    return {
        "data": data,
        "learner": learner,
        "seed": seed,
        "transitions": learned["transitions"],
        "updates": learned["updates"],
        "cpu_s": round(learned["cpu_s"], 1),
        **{name: ridden[name] for name in (*names, "path_ratio")},
        "shaken_fall_rate": learned["best"]["shaken_fall_rate"],
        "last_reach_rate": learned["last"]["reach_rate"],
        "last_fall_rate": learned["last"]["fall_rate"],
        "first_95_percent": good[0] if good else None,
        "mean_q": learned["q_policy"],
        "refused": learned["refused"],
        "run": json.loads((folder / "run" / "run.json").read_text()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--only", default="", help="runs with this in DATA-LEARNER only")
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    record(args.work / "bags")
    wanted = [
        (data, learner, seed)
        for data in DATA
        for learner in LEARNERS
        for seed in (args.seeds[:1] if learner == "imitation" else args.seeds)
        if args.only in f"{data}-{learner}"
    ]
    rows = [learn(args.work, *each) for each in tqdm(wanted, unit="run")]
    about = {**origin(), "machine": machine("torch", "numpy")}
    args.out.parent.mkdir(exist_ok=True)
    args.out.write_text(json.dumps({**about, "runs": rows}, indent=1) + "\n")
    for row in rows:
        print(
            f"{row['data']:8} {row['learner']:11} {row['seed']} {row['reach_rate']:7.1%}"
            f" reached {row['fall_rate']:7.1%} fell, {row['shaken_fall_rate']:7.1%} when shaken,"
            f" 95 % after {row['first_95_percent']}"
        )


if __name__ == "__main__":
    main()
