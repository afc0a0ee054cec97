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
PPO = "stable-baselines3 PPO, stock networks, 64 bicycles"
TITLES = {
    "quick": ("`quick`", "its own"),
    "fast": ("`fast`", "its own"),
    "ppo-tuned": (f"{PPO}, tuned", "as registered"),
    "ppo-tuned-fast": (f"{PPO}, tuned", "`fast`'s"),
    "ppo-short": (f"{PPO}, tuned, 64 steps a rollout", "as registered"),
    "sbx-ppo": ("SBX PPO, stock networks, 64 bicycles, tuned", "as registered"),
    "td3-quick": ("stable-baselines3 TD3, recipe of `quick`, layer norm", "`fast`'s"),
    "td3-recipe": ("stable-baselines3 TD3, recipe of `fast`, layer norm", "`fast`'s"),
    "sbx-quick": ("SBX TD3, recipe of `quick`, layer norm", "`fast`'s"),
    "sbx-td3": ("SBX TD3, recipe of `fast`, layer norm", "`fast`'s"),
    "sac-recipe": ("stable-baselines3 SAC, recipe of `fast`", "`fast`'s"),
    "sbx-sac": ("SBX SAC, recipe of `fast`, layer norm", "`fast`'s"),
    "crossq-recipe": ("sb3-contrib CrossQ, recipe of `fast`", "`fast`'s"),
    "ppo-fast": (PPO, "`fast`'s"),
    "ppo": (PPO, "as registered"),
    "td3": ("stable-baselines3 TD3, stock networks, 64 bicycles", "as registered"),
    "sac": ("stable-baselines3 SAC, stock networks, 64 bicycles", "as registered"),
    "tqc": ("sb3-contrib TQC, stock networks, 64 bicycles", "as registered"),
    "untuned-td3": ("stable-baselines3 TD3, untuned: one bicycle, frozen falls", "as registered"),
}
"""Learner and starts by the names of bench_goals."""
OURS = ("quick", "fast")
HEAD = (
    "| learner | starts | steps, median | updates, median | CPU s of each seed | times `quick` |",
    "| --- | --- | --- | --- | --- | --- |",
)

Results = dict[str, Any]


def rows(results: Results) -> list[str]:
    """Return the table in lines of Markdown."""
    base = seconds(results, "quick")
    lines = list(HEAD)
    for name, (title, starts) in TITLES.items():
        curves = _curves(results, name)
        if not curves:
            continue
        each = ", ".join(_seconds(curve[-1], results["wanted"]) for curve in curves)
        steps = f"{_median(curves, 'steps') / 1e6:.2f} M"
        updates = f"{_median(curves, 'updates'):,.0f}"
        over = "" if reached(results, name) else "over "
        times = f"{over}{seconds(results, name) / base:.1f}"
        lines.append(f"| {title} | {starts} | {steps} | {updates} | {each} | {times} |")
    return lines


def best_peer(results: Results) -> str:
    """Return the name of the peer with the least median time, of those that mostly reached it."""
    peers = [name for name in results["runs"] if name not in OURS and reached(results, name)]
    return min(peers, key=lambda name: seconds(results, name))


def sentences(results: Results) -> list[str]:
    """Return what the table shows, in three sentences."""
    return [_best(results), _compiling(results), _bought(results)]


def _best(results: Results) -> str:
    """Return the comparison with the best peer."""
    name = best_peer(results)
    title, starts = TITLES[name]
    starts = "registered starts" if starts == "as registered" else f"{starts} starts"
    times = [f"{seconds(results, name) / seconds(results, mine):.1f}" for mine in OURS]
    return (
        f"The quickest peer is {title}, on {starts}: its median takes {times[0]} times as long as"
        f" that of `quick` and {times[1]} times as long as that of `fast`."
    )


def _compiling(results: Results, name: str = "sbx-ppo") -> str:
    """Return how much of a compiled peer's time is over when its first updates are scored."""
    curves = _curves(results, name)
    before = [next(row["cpu_s"] for row in curve if row["updates"]) for curve in curves]
    rest = [curve[-1]["cpu_s"] - spent for curve, spent in zip(curves, before, strict=True)]
    times = statistics.median(rest) / seconds(results, "quick")
    return (
        f"SBX's PPO spends {statistics.median(before):.1f} s until its first updates are scored,"
        f" mostly compiling; what follows takes {times:.1f} times as long as `quick`."
    )


def _bought(results: Results, name: str = "td3-quick") -> str:
    """Return what the recipe buys, and what the implementation."""
    (mine, each), (theirs, their_each) = (_updates(results, who) for who in ("quick", name))
    return (
        "The recipe is what makes the goals learnable in some thousand updates:"
        f" stable-baselines3's TD3 with the recipe of `quick` needs {theirs:,.0f}, `quick`"
        f" {mine:,.0f}; the implementation makes each of them cheap: {each:.2f} ms beside"
        f" {their_each:.2f} ms, collecting included."
    )


def _updates(results: Results, name: str) -> tuple[float, float]:
    """Return the medians of a learner's updates and of the processor time of one, ms."""
    curves = _curves(results, name)
    each = [1e3 * curve[-1]["cpu_s"] / curve[-1]["updates"] for curve in curves]
    return _median(curves, "updates"), statistics.median(each)


def seconds(results: Results, name: str) -> float:
    """Return the median processor time of a learner's runs, s."""
    return _median(_curves(results, name), "cpu_s")


def reached(results: Results, name: str) -> bool:
    """Return True if more than half of a learner's runs came to the wanted share of goals."""
    ends = [_reached(curve[-1], results["wanted"]) for curve in _curves(results, name)]
    return 2 * sum(ends) > len(ends)


def _curves(results: Results, name: str) -> list[list[dict[str, Any]]]:
    return list(results["runs"].get(name, {}).values())


def _median(curves: list[list[dict[str, Any]]], key: str) -> float:
    return statistics.median(curve[-1][key] for curve in curves)


def _seconds(end: dict[str, Any], wanted: float) -> str:
    """Return the time of a run's end, or for how long it did not reach the share of goals."""
    if _reached(end, wanted):
        return f"{end['cpu_s']:.1f}"
    return f"not in {end['cpu_s']:.0f} ({100 * end['rate']:.0f} %)"


def _reached(end: dict[str, Any], wanted: float) -> bool:
    return bool(end["goals"] == 1000 and end["rate"] >= wanted)


if __name__ == "__main__":
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else RESULTS
    found = json.loads(path.read_text())
    print("\n".join([*rows(found), "", *sentences(found)]))
