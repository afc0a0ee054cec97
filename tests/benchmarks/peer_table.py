"""The table of peers in docs/training.md, from the file that `bench_goals.py` writes.

python tests/benchmarks/peer_table.py [results/goals.json]
"""

from __future__ import annotations

import json
import statistics
import sys
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).parent / "results" / "goals.json"
TITLES = {
    "quick": ("`quick`", "its own"),
    "fast": ("`fast`", "its own"),
    "td3-quick": ("stable-baselines3 TD3, recipe of `quick`", "`fast`'s"),
    "td3-recipe": ("stable-baselines3 TD3, recipe of `fast`", "`fast`'s"),
    "sbx-quick": ("SBX TD3, recipe of `quick`, layer norm", "`fast`'s"),
    "sbx-td3": ("SBX TD3, recipe of `fast`, layer norm", "`fast`'s"),
    "sac-recipe": ("stable-baselines3 SAC, recipe of `fast`", "`fast`'s"),
    "crossq-recipe": ("sb3-contrib CrossQ, recipe of `fast`", "`fast`'s"),
    "ppo-tuned": ("stable-baselines3 PPO, stock networks, 64 bicycles, tuned", "as registered"),
    "ppo-short": (
        "stable-baselines3 PPO, stock networks, 64 bicycles, tuned, 64 steps a rollout",
        "as registered",
    ),
    "ppo-fast": ("stable-baselines3 PPO, stock networks, 64 bicycles", "`fast`'s"),
    "ppo": ("stable-baselines3 PPO, stock networks, 64 bicycles", "as registered"),
    "td3": ("stable-baselines3 TD3, stock networks, 64 bicycles", "as registered"),
    "sac": ("stable-baselines3 SAC, stock networks, 64 bicycles", "as registered"),
    "tqc": ("sb3-contrib TQC, stock networks, 64 bicycles", "as registered"),
    "untuned-td3": ("stable-baselines3 TD3, untuned", "as registered"),
}
"""Learner and starts by the names of bench_goals."""
HEAD = (
    "| learner | starts | steps, median | updates, median | CPU s of each seed | times `quick` |",
    "| --- | --- | --- | --- | --- | --- |",
)


def rows(results: dict[str, Any]) -> list[str]:
    """Return the table in lines of Markdown."""
    runs: dict[str, dict[str, list[dict[str, Any]]]] = results["runs"]
    base = _median(list(runs["quick"].values()), "cpu_s")
    lines = list(HEAD)
    for name, (title, starts) in TITLES.items():
        curves = list(runs.get(name, {}).values())
        if not curves:
            continue
        each = ", ".join(_seconds(curve[-1], results["wanted"]) for curve in curves)
        steps = f"{_median(curves, 'steps') / 1e6:.2f} M"
        updates = f"{_median(curves, 'updates'):,.0f}"
        times = f"{_median(curves, 'cpu_s') / base:.1f}"
        lines.append(f"| {title} | {starts} | {steps} | {updates} | {each} | {times} |")
    return lines


def _median(curves: list[list[dict[str, Any]]], key: str) -> float:
    return statistics.median(curve[-1][key] for curve in curves)


def _seconds(end: dict[str, Any], wanted: float) -> str:
    """Return the time of a run's end, and its share of goals if that was too small."""
    reached = end["goals"] == 1000 and end["rate"] >= wanted
    return f"{end['cpu_s']:.1f}" + ("" if reached else f" (not: {100 * end['rate']:.0f} %)")


if __name__ == "__main__":
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else RESULTS
    print("\n".join(rows(json.loads(path.read_text()))))
