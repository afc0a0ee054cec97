"""Compare the policy that recorded with the one that learned from it (`record_and_learn.sh`)."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_tools.record_and_learn")

import json
import sys
from pathlib import Path
from typing import Any

BETTER, NOT_BETTER = 0, 5
"""Exit statuses."""

RIDDEN = (
    ("goals reached", "reached", "{:.0f}"),
    ("falls", "falls", "{:.0f}"),
    ("simulated time", "ridden_time", "{:.1f} s"),
    ("path over straight line", "path_ratio", "{:.3f}"),
)
EVALUATED = (
    ("reached", "reach_rate", "{:.1%}"),
    ("fell", "fall_rate", "{:.1%}"),
    ("time to goal, median", "median_time_s", "{:.1f} s"),
    ("path over shortest, median", "path_ratio", "{:.3f}"),
)


def is_better(comparison: dict[str, Any]) -> bool:
    """Return True if the first policy of `bicycle evaluate --against` is the better one.

    It reaches more goals minus falls, or equally many and does better in more rides.
    """
    new, old = comparison, comparison["against"]
    gain = (new["reach_rate"] - new["fall_rate"]) - (old["reach_rate"] - old["fall_rate"])
    rides = comparison["comparison"]
    return gain > 0 or (gain == 0 and rides["first_better"] > rides["second_better"])


def text_of(before: dict[str, Any], after: dict[str, Any], comparison: dict[str, Any]) -> str:
    """Return the table: rides by the nodes, then the pairs in simulation."""
    new, old = comparison, comparison["against"]
    lines = [_row("", "before", "after"), _row("", old["controller"], new["controller"])]
    lines.append("the same goals, ridden by the nodes:")
    lines += [_row(f"  {label}", *_cells(before, after, k, form)) for label, k, form in RIDDEN]
    lines.append(f"the same {new['episodes']:,} random pairs, in simulation:")
    lines += [_row(f"  {label}", *_cells(old, new, k, form)) for label, k, form in EVALUATED]
    rides = comparison["comparison"]
    lines.append(
        f"better in {rides['first_better']:,} of them, equal in {rides['equal']:,}, worse in "
        f"{rides['second_better']:,}"
    )
    better = is_better(comparison)
    lines.append("the new policy is better" if better else "the new policy is NOT better")
    return "\n".join(lines)


def _cells(one: dict[str, Any], other: dict[str, Any], key: str, form: str) -> list[str]:
    return ["-" if item[key] is None else form.format(item[key]) for item in (one, other)]


def _row(label: str, first: str, second: str) -> str:
    return f"{label:30}{_short(first):>26}{_short(second):>26}"


def _short(text: str) -> str:
    """Return a policy's id without the middle of a long name."""
    return text if len(text) <= 25 else f"{text[:12]}..{text[-11:]}"


def main() -> None:
    """Print the table of a folder; exit with 0 if the new policy is better."""
    folder = Path(sys.argv[1])
    names = ("before/summary.json", "after/summary.json", "comparison.json")
    before, after, comparison = (json.loads((folder / name).read_text()) for name in names)
    print(text_of(before, after, comparison))
    sys.exit(BETTER if is_better(comparison) else NOT_BETTER)
