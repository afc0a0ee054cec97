"""Gain by each ingredient of the preset `fast`: the same run without it.

Every run makes the same number of updates on random goals at 10 km/h, d up to 20 cm, and every
500 updates its actor is scored on the run's own fixed starts, far and near. Told are, by seed,
the best score (share of goals less share of falls, far and near alike), the updates until that was
99 %, and the median time to the far goals. Seeds take turns, so an ended benchmark has whole
rounds; the same command goes on where it was.

    python tests/benchmarks/bench_ablation.py [--seeds 1 2 3] [--updates 6000] [--jobs 1]
"""

from __future__ import annotations

import argparse
import json
import shlex
import statistics
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import torch
from machine import machine
from tqdm import tqdm

from bicycle_controller.config import loading
from bicycle_controller.training import online
from bicycle_controller.training.run_folder import origin

RESULTS = Path(__file__).parent / "results" / "ablation.json"
WANTED = 0.99

NARROW = ("noise.sigma=0.02", "noise.sigma_max=0.06", "noise.theta=0.1")
PLAIN = ("ddpg.symmetric_actor=false",)
UNCAPPED = ("ddpg.cost_cap=0", "ddpg.reward_min=-25")
PENALTY = ("ddpg.fall_penalty=6", "ddpg.reward_scale=0.02")
VARIANTS: dict[str, tuple[str, ...]] = {
    "fast": (),
    "16 bicycles": ("bicycles=16",),
    "one-step returns": ("ddpg.n_step=1",),
    "one critic": ("ddpg.critics=1",),
    "no layer norm": ("ddpg.critic_layer_norm=false",),
    "no near goals": ("starts.near_share=0",),
    "no mirrored batches": ("ddpg.mirror=false",),
    "no averaged actor": ("ddpg.actor_average=0",),
    "no cost cap": (*UNCAPPED, "ddpg.reward_scale=0.02"),
    "fall penalty": PENALTY,
    "fall penalty, no cost cap": (*UNCAPPED, *PENALTY),
    "values not bounded": ("ddpg.bound_values=false",),
    "upright starts": (
        "starts.tilt=0",
        "starts.tilt_rate=0",
        "starts.steer=0",
        "starts.steer_rate=0",
    ),
    "tau 0.005": ("ddpg.tau=0.005",),
    "batch 64": ("ddpg.batch=64",),
    "narrow noise": NARROW,
    "plain actor": PLAIN,
    "narrow noise, plain actor": (*NARROW, *PLAIN),
}
"""Overrides by title."""


def run(title: str, seed: int, updates: int) -> dict[str, Any]:
    """Make one run; its scores."""
    torch.set_num_threads(1)
    changes = (f"seed={seed}", "tensorboard=false", "save_every=100000", "evaluation.every=500")
    config = loading.preset("fast", [*changes, *VARIANTS[title]])
    steps = config.warm_up + updates * config.bicycles
    config = loading.preset("fast", [*changes, *VARIANTS[title], f"steps={steps}"])
    with tempfile.TemporaryDirectory() as folder:
        result = online.run(config, Path(folder) / "run")
        lines = (Path(folder) / "run" / "log.jsonl").read_text().splitlines()
    scores = [row for row in map(json.loads, lines) if row["kind"] == "evaluation"]
    worth = [
        0.5
        * (row["reach_rate"] - row["fall_rate"] + row["near_reach_rate"] - row["near_fall_rate"])
        for row in scores
    ]
    good = [row["updates"] for row, value in zip(scores, worth, strict=True) if value >= WANTED]
    best = scores[max(range(len(worth)), key=worth.__getitem__)]
    return {
        "title": title,
        "seed": seed,
        "best": max(worth),
        "updates_to_99": good[0] if good else None,
        "median_time_s": best["median_time_s"],
        "cpu_s": result.cpu_s,
    }


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Per variant, in the order of the seeds."""
    found: dict[str, Any] = {}
    for title in VARIANTS:
        mine = sorted((row for row in rows if row["title"] == title), key=lambda row: row["seed"])
        if mine:
            found[title] = {
                "best, median": statistics.median(row["best"] for row in mine),
                **{key: [row[key] for row in mine] for key in ("best", "updates_to_99")},
            }
    return found


def main() -> None:
    """Run what is missing, print and write the results."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--updates", type=int, default=6_000)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    old = json.loads(args.out.read_text()) if args.out.exists() else {}
    rows: list[dict[str, Any]] = old.get("runs", [])
    if rows and old["updates"] != args.updates:
        parser.error(f"{args.out} holds runs of {old['updates']} updates: give another --out")
    there = {(row["title"], row["seed"]) for row in rows}
    trials = [(title, seed) for seed in args.seeds for title in VARIANTS]
    about = {
        "command": shlex.join(["python", *sys.argv]),
        "commit": origin()["commit"],
        "machine": machine("numpy", "torch"),
        "updates": args.updates,
    }
    with ProcessPoolExecutor(args.jobs) as pool:
        missing = [trial for trial in trials if trial not in there]
        futures = [pool.submit(run, *trial, args.updates) for trial in missing]
        for future in tqdm(as_completed(futures), total=len(futures), unit="run", disable=None):
            rows.append(future.result())
            tqdm.write(str(rows[-1]))
            result = about | {"summary": summary(rows), "runs": rows}
            args.out.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
