"""End of a recording: one moment for all topics, by the times of sending."""

from __future__ import annotations

import statistics
import time
from collections import deque
from typing import NamedTuple

LEAST_SKEW_NS = 50_000_000
"""Smaller differences between sending and receiving are transport, not another clock."""
FEWEST, MOST = 5, 60
"""Seconds with messages from which a clock's offset is estimated."""
SECOND_NS = 1_000_000_000
LONGEST_END = 5.0
"""Longest wait for messages from before the end (s)."""
LONGEST_END_NS = int(1e9 * LONGEST_END)


class Cut(NamedTuple):
    """The moment at which a recording ends."""

    time_ns: int
    """Time on this host's clock as it is set now, ns."""
    set_back_ns: int = 0
    """Time by which that clock was set back while the recording ran; see `SetBack`."""

    def is_before(self, sent_ns: int) -> bool:
        """Return True if a message was sent after the end.

        A message that waits in a subscription when the clock is set back was sent before, though
        its time lies beyond the end: by at most the set-back, and by more than the end can last.
        """
        late = sent_ns - self.time_ns
        return late > 0 and not LONGEST_END_NS < late <= self.set_back_ns


class SetBack:
    """Measure how far this host's clock was set back, by the steady clock."""

    def __init__(self) -> None:
        self._furthest = time.time_ns() - time.monotonic_ns()

    def look(self) -> int:
        """Return how far the clock is behind where it was at most at earlier looks, ns."""
        ahead = time.time_ns() - time.monotonic_ns()
        self._furthest = max(self._furthest, ahead)
        return self._furthest - ahead


class SourceClock:
    """Offset of a publisher's clock from this host's.

    Times of sending are read from the publisher's clock, which on another host may be ahead or
    behind. Among the messages of one second at least one has almost no transport time, so the
    smallest difference between receiving and sending is the offset of the clocks. The median over
    some seconds ignores a second in which a clock was set or all messages were late.
    """

    def __init__(self) -> None:
        self._smallest: deque[int] = deque(maxlen=MOST)
        self._second = -1

    def add(self, received_ns: int, sent_ns: int, now_ns: int) -> None:
        """Learn from a message.

        Args:
            received_ns: On this host's clock.
            sent_ns: On the publisher's.
            now_ns: On a steady clock.
        """
        way = received_ns - sent_ns
        second = now_ns // SECOND_NS
        if second != self._second:
            self._second = second
            self._smallest.append(way)
        elif way < self._smallest[-1]:
            self._smallest[-1] = way

    def here(self, sent_ns: int) -> int:
        """Convert a time of the publisher's clock to this host's, ns."""
        if len(self._smallest) < FEWEST:
            return sent_ns
        skew = statistics.median_low(self._smallest)
        return sent_ns + skew if abs(skew) >= LEAST_SKEW_NS else sent_ns
