"""Report on a data set, to inspect it before learning."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from bicycle_common.observation import ACTION_FIELDS, OBSERVATION_FIELDS
from bicycle_controller.data.dataset import Dataset

BINS = 10
"""Bins of each action's histogram, over its limits."""
CELLS = (9, 24)
"""Cells of the coverage: lean by steer."""
CLOCK_GAP = 1.0
"""Time between two steps of one pursuit that counts as a clock gap (s)."""
SHADES = " .:+*#"
"""Shades from no visit to the most visits, on a logarithmic scale."""


def report(data: Dataset) -> dict[str, Any]:
    """Return statistics of a data set, ready for JSON.

    `lost` counts missing messages; `clock_gaps` counts the steps recorded a second or more after
    the previous one, or earlier than it; `coverage` holds visits by lean (rows,
    from the fall angle on the left to that on the right) and by steer (columns, from the stop
    on the right to that on the left).
    """
    found = data.transitions
    steps = data.plant.time_step
    pursuits = int(found.ended.sum())
    names, counts = np.unique(found.policy.astype(str), return_counts=True)
    waits = np.diff(found.time)[~found.ended[:-1]]
    return {
        "bags": [vars(source) for source in data.sources],
        "scenario": data.scenario.name,
        "transitions": len(found),
        "minutes": len(found) * steps / 60.0,
        "pursuits": pursuits,
        "goals": int(found.terminated.sum()),
        "falls": int(found.fallen.sum()),
        "fall_share": float(found.fallen.sum()) / max(pursuits, 1),
        "mean_reward": float(found.reward.mean()) if len(found) else None,
        "actions": _actions(data),
        "coverage": _coverage(data),
        "policies": {str(n): int(c) for n, c in zip(names, counts, strict=True)},
        "lost": dict(data.lost),
        "clock_gaps": int(((waits > CLOCK_GAP) | (waits < 0)).sum()),
        "load_s": data.load_s,
    }


def _actions(data: Dataset) -> dict[str, Any]:
    """Return the range and histogram of each action that is driven."""
    table = {}
    for index, name in enumerate(ACTION_FIELDS):
        limit = float(data.scenario.action_limits[index])
        values = data.transitions.action[:, index]
        if limit == 0 or not len(values):
            continue
        counts, _ = np.histogram(np.clip(values, -limit, limit), BINS, (-limit, limit))
        table[name] = {
            "limit": limit,
            "range": [float(values.min()), float(values.max())],
            "mean": float(values.mean()),
            "standard_deviation": float(values.std()),
            "at_limit": float((np.abs(values) >= limit).mean()),
            "histogram": counts.tolist(),
        }
    return table


def _coverage(data: Dataset) -> list[list[int]]:
    columns = dict(zip(OBSERVATION_FIELDS, data.transitions.observation.T, strict=True))
    fall, stop = data.scenario.fall_angle, data.plant.geometry.steer_stop
    lean = np.clip(columns["lean_angle"], -fall, fall)
    steer = np.clip(columns["steer_angle"], -stop, stop)
    counts, _, _ = np.histogram2d(lean, steer, CELLS, ((-fall, fall), (-stop, stop)))
    table: list[list[int]] = counts[::-1].astype(int).tolist()
    return table


def as_text(found: dict[str, Any]) -> str:
    """Return the report as text that fits one screen."""
    lost = ", ".join(f"{count} {name}" for name, count in found["lost"].items())
    rebuilt = sum(not bag["recorded"] for bag in found["bags"])
    lines = [
        f"{found['transitions']:,} transitions ({found['minutes']:.1f} min) from"
        f" {len(found['bags'])} bags, {rebuilt} of them rebuilt from states, in"
        f" {found['load_s']:.1f} s",
        f"{found['pursuits']:,} pursuits: {found['goals']:,} goals, {found['falls']:,} falls"
        f" ({found['fall_share']:.1%}); lost: {lost}; clock gaps: {found['clock_gaps']}",
        "ridden by " + ", ".join(f"{name} ({n:,})" for name, n in found["policies"].items()),
    ]
    for name, values in found["actions"].items():
        low, high = values["range"]
        lines.append(
            f"{name:13} {low:8.3g} to {high:<8.3g} at the limit {values['at_limit']:6.1%}"
            f"  [{_bars(values['histogram'])}]"
        )
    lines.append("lean (up: left) by steer (from the right stop to the left), visits:")
    most = max((max(row) for row in found["coverage"]), default=0)
    lines += ["  |" + "".join(_shade(n, most) for n in row) + "|" for row in found["coverage"]]
    return "\n".join(lines)


def _bars(counts: list[int]) -> str:
    most = max([*counts, 1])
    return "".join(_shade(count, most) for count in counts)


def _shade(count: int, most: int) -> str:
    if count == 0:
        return SHADES[0]
    share = math.log1p(count) / math.log1p(most)
    return SHADES[max(1, round(share * (len(SHADES) - 1)))]
