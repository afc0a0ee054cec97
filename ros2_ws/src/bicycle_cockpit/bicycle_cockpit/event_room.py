"""Rate limit of events by kind: goals, pushes and others can come at any rate."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable

from bicycle_cockpit.rate_limiter import RateLimiter

RATE, BURST = 2.0, 100.0
"""Events of one kind per second in the long run, and at once."""
COUNT_RATE, COUNT_BURST = 0.2, 5.0
"""Rate of the messages about omitted events, per second and at once."""


class EventRoom:
    """Rate limits by kind, so that a flood of one kind hides no other, such as a fall."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Start with full rates; `clock` is steady, s."""
        self._rooms = defaultdict[str, RateLimiter](lambda: RateLimiter(RATE, BURST, clock))
        self._counts = RateLimiter(COUNT_RATE, COUNT_BURST, clock)
        self._left_out = 0

    def take(self, kind: str) -> bool:
        """Return True if one more of this kind may be reported; count it otherwise."""
        room = self._rooms[kind].take()
        self._left_out += not room
        return room

    def left_out(self) -> int:
        """Return the number omitted since the last report; 0 if it is too early to report."""
        if not self._left_out or not self._counts.take():
            return 0
        count, self._left_out = self._left_out, 0
        return count
