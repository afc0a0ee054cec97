"""Speeds along a path: as fast as asked, slower before and in turns.

A turn's speed is the highest at which the bicycle can still ride its curvature. Backwards from
every turn the bicycle brakes, and forwards from it it speeds up again, at a limited rate.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bicycle_common.validation import require
from bicycle_controller.control.path import Path

CHANGE = 0.3
"""Largest change of the speed, m/s^2."""
SPEEDS_TRIED = 141
"""Speeds between the slowest and the wanted one that a curvature is compared with."""
MARGIN = 0.8
"""Share of the rideable curvature that a path may use at the speed of its profile."""
SMOOTH = 1.0
"""m over which a path's curvature is averaged before it limits the speed."""


def speed_profile(
    path: Path,
    wanted: float,
    sharpest: Callable[[np.ndarray], np.ndarray],
    slowest: float = 2.0,
    stop: bool = False,
) -> np.ndarray:
    """Return the speed at every sample of a path, (M,) m/s.

    Args:
        path: the path.
        wanted: m/s where nothing limits it.
        sharpest: returns the largest curvatures, 1/m, that can be ridden at speeds (K,), m/s.
        slowest: m/s, no turn is ridden more slowly: a bicycle cannot balance then.
        stop: True to end an open path at the slowest speed.

    Raises:
        ValueError: if the wanted speed is below the slowest.
    """
    require(slowest <= wanted, f"the speed {wanted:g} m/s is below the lowest, {slowest:g} m/s")
    speeds = np.linspace(slowest, wanted, SPEEDS_TRIED)
    # A higher speed never rides a sharper turn than all lower ones together.
    best = np.maximum.accumulate(MARGIN * sharpest(speeds)[::-1])[::-1]
    size = max(1, round(SMOOTH / path.spacing))
    padded = np.pad(np.abs(path.curvature), size, mode="wrap" if path.closed else "edge")
    bend = np.convolve(padded, np.full(size, 1.0 / size), mode="same")[size:-size]
    allowed = np.interp(-bend, -best, speeds) if best[0] > best[-1] else np.full(len(bend), wanted)
    if stop and not path.closed:
        allowed[-1] = slowest
    laps = 2 if path.closed else 1
    allowed = np.tile(allowed, laps)
    allowed = _limited(_limited(allowed[::-1], path.spacing)[::-1], path.spacing)
    return np.asarray(allowed[-len(bend) :])


def _limited(speeds: np.ndarray, spacing: float) -> np.ndarray:
    """Let the speed grow by CHANGE at most, from the first sample on."""
    # v^2 grows by at most 2 a s: a running minimum of v^2 less the line through it.
    line = 2.0 * CHANGE * spacing * np.arange(len(speeds))
    return np.asarray(np.sqrt(np.minimum.accumulate(speeds * speeds - line) + line))
