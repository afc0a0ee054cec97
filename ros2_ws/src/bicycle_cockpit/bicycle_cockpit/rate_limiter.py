"""Rate limiter."""

from __future__ import annotations

import time
from collections.abc import Callable


class RateLimiter:
    """Token bucket: `burst` at once, `rate` per second in the long run."""

    def __init__(
        self, rate: float, burst: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Start with a full bucket.

        Args:
            rate: per second.
            burst: at once.
            clock: steady clock, s.
        """
        self._rate, self._burst, self._clock = rate, burst, clock
        self._left, self._asked = burst, clock()

    def take(self) -> bool:
        """Take one token; return False if there is none."""
        now = self._clock()
        self._left = min(self._burst, self._left + (now - self._asked) * self._rate)
        self._asked = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
