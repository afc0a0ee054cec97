"""Rate of messages and its regularity."""

from __future__ import annotations

from collections import deque

import numpy as np

WINDOW = 1000
"""Number of latest arrivals that count."""


class Rate:
    """Arrivals of messages."""

    def __init__(self, window: int = WINDOW) -> None:
        self.count = 0
        self._times: deque[float] = deque(maxlen=window)
        self._sizes: deque[int] = deque(maxlen=window)

    def add(self, time: float, size: int) -> None:
        """Count one message.

        Args:
            time: s, by a steady clock.
            size: bytes.
        """
        self.count += 1
        self._times.append(time)
        self._sizes.append(size)

    @property
    def hertz(self) -> float:
        """Messages per second; NaN before the second one."""
        periods = np.diff(self._times)
        return float(1.0 / periods.mean()) if len(periods) and periods.sum() > 0 else float("nan")

    def __str__(self) -> str:
        """Return the rate as one line."""
        if len(self._times) < 2:
            return f"{self.count} messages so far"
        periods = 1e3 * np.diff(self._times)
        shortest, longest, spread = periods.min(), periods.max(), periods.std()
        size = float(np.mean(self._sizes))
        return (
            f"{self.hertz:.2f} Hz, period {shortest:.1f} to {longest:.1f} ms "
            f"(deviation {spread:.2f} ms), {size:.0f} bytes, {self.count} messages"
        )
