"""Common elements of pictures of a ride: colours, style, and the time axis."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bicycle_common import plot_style
from bicycle_tools.ride_log import RideLog

REACHED, FAILED, LEAN, STEER, TORQUE, SHIFT = (
    "#0b8457",
    "#c0392b",
    "#3a5ba0",
    "#d1495b",
    "#5f4b8b",
    "#e08e0b",
)
STYLE: Any = plot_style.STYLE | {"axes.formatter.useoffset": False}

Floats = NDArray[np.float64]

LARGEST = 1e9
"""Largest number that is drawn, in any unit: axes that hold much larger ones overflow."""


def drawable(values: Floats) -> Floats:
    """Return values with NaN, which is not drawn, for what is infinite or beyond LARGEST."""
    return np.where(np.abs(values) <= LARGEST, values, np.nan)


def ride_time(log: RideLog) -> Floats:
    """Return the states' simulated time since the start, s, (n,); it continues over resets."""
    if not len(log.segment):
        return np.empty(0)
    elapsed = np.diff(log.states["header.stamp"])
    elapsed[(np.diff(log.segment) != 0) | ~(elapsed >= 0)] = 0.0
    return np.concatenate([[0.0], np.cumsum(elapsed)])


def envelope(time: Floats, values: Floats, most: int) -> tuple[Floats, Floats]:
    """Return a line with fewer points that looks the same: the extremes of each stretch.

    Args:
        time: (n,) in order.
        values: (n,); those that are not drawable are left out.
        most: points to keep at most, about.

    Returns:
        The times and values that are left, in order.
    """
    if len(values) <= most:
        return time, drawable(values)
    values = drawable(values)
    stretch = -(-2 * len(values) // most)
    rows = np.arange(len(values) + -len(values) % stretch).reshape(-1, stretch)
    rows = np.minimum(rows, len(values) - 1)
    finite = np.isfinite(values)[rows]
    low = np.where(finite, values[rows], np.inf).argmin(axis=1)
    high = np.where(finite, values[rows], -np.inf).argmax(axis=1)
    picked = np.sort(np.stack([low, high], axis=1), axis=1)
    kept = np.take_along_axis(rows, picked, axis=1).ravel()
    return time[kept], values[kept]
