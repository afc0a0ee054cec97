"""How many events of a kind are told: goals, pushes and the rest can come at any rate."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable

from bicycle_cockpit.rate_limiter import RateLimiter

RATE, BURST = 2.0, 100.0
"""Events of one kind a second in the long run, and at once."""
COUNT_RATE, COUNT_BURST = 0.2, 5.0
"""How often it is told how many were left out."""


class EventRoom:
    """Room for events, by kind: a flood of one hides no other, such as a fall."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Begin with room for all; `clock` is steady, s."""
        self._rooms = defaultdict[str, RateLimiter](lambda: RateLimiter(RATE, BURST, clock))
        self._counts = RateLimiter(COUNT_RATE, COUNT_BURST, clock)
        self._left_out = 0

    def take(self, kind: str) -> bool:
        """Return True if one more of this kind may be told; if not, it is counted."""
        room = self._rooms[kind].take()
        self._left_out += not room
        return room

    def left_out(self) -> int:
        """How many were left out since this was told last; 0 where it is too early to tell."""
        if not self._left_out or not self._counts.take():
            return 0
        count, self._left_out = self._left_out, 0
        return count
