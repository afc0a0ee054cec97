"""Directions in which a bag's goals were to be reached."""

from __future__ import annotations

from typing import Any

import numpy as np

from bicycle_cockpit.marks import Ridden, rows_of
from bicycle_cockpit.samples import plain
from bicycle_common import arrival

MOST_ARRIVALS = 2_000
POSE = "pose.orientation."


def arrivals(ridden: Ridden) -> list[dict[str, Any]]:
    """Return `t` (s), `x`, `y` (m) and `heading` (rad, None for any) of goals that became active.

    A goal that is sent again with another direction is there again.
    """
    found = ridden.ride.active_goals
    if f"{POSE}w" not in found:
        return []
    turns = np.stack([found[POSE + name] for name in "xyzw"], axis=1).tolist()
    places = zip(found["pose.position.x"], found["pose.position.y"], strict=True)
    rows = zip(rows_of(ridden, found), places, turns, strict=True)
    return [
        {
            "t": round(float(ridden.time[row]), 3),
            "x": plain(float(x)),
            "y": plain(float(y)),
            "heading": None if (yaw := arrival.yaw_of(tuple(turn))) is None else plain(yaw),
        }
        for row, (x, y), turn in list(rows)[:MOST_ARRIVALS]
    ]
