"""Punctuality of the control loop, from the simulator's timing messages."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float64]

WINDOW = 10.0
"""Time window of a live ride's figures (s)."""


def loop_figures(period: Numbers, lateness: Numbers, latency: Numbers) -> dict[str, float | None]:
    """Return rate (Hz), jitter and latency (ms) of some steps; None if not measured.

    Args:
        period: (n,) s since the step before; NaN for a first one.
        lateness: (n,) s after the step was due; NaN in lock-step.
        latency: (n,) s from a state to its command; NaN without one.

    Returns:
        Jitter is the deviation of a period from the median, in lock-step too.
    """
    finite = period[np.isfinite(period)]
    middle = float(np.median(finite)) if len(finite) else 0.0
    figures: dict[str, float | None] = {
        "rate": round(len(finite) / float(finite.sum()), 3) if finite.sum() > 0 else None
    }
    for name, values in (
        ("jitter", np.abs(finite - middle)),
        ("lateness", lateness),
        ("latency", latency),
    ):
        known = values[np.isfinite(values)] * 1e3
        for label, share in (("p50", 0.5), ("p99", 0.99), ("max", 1.0)):
            value = round(float(np.quantile(known, share)), 3) if len(known) else None
            figures[f"{name}_{label}"] = value
    return figures


class LoopStats:
    """Figures over the last seconds."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Start without figures; `clock` is steady, s."""
        self._clock = clock
        self._kept: deque[tuple[float, float, float, float]] = deque()
        self._late = self._dropped = 0

    def add(self, timing: Any) -> None:
        """Add one LoopTiming message, or an object with its fields."""
        now = self._clock()
        self._kept.append((now, timing.period, timing.lateness, timing.latency))
        self._late, self._dropped = int(timing.late_steps), int(timing.dropped_steps)
        self._forget(now)

    def figures(self) -> dict[str, float | None]:
        """Return `loop_figures`, and the late and dropped steps since the simulator started."""
        self._forget(self._clock())
        kept = np.array([row[1:] for row in self._kept], dtype=np.float64).reshape(-1, 3)
        found = loop_figures(kept[:, 0], kept[:, 1], kept[:, 2])
        return {**found, "late": self._late, "dropped": self._dropped}

    def _forget(self, now: float) -> None:
        while self._kept and now - self._kept[0][0] > WINDOW:
            self._kept.popleft()
