"""End of a recording: one moment for all topics, by the times of sending."""

from __future__ import annotations

import statistics
from collections import deque

LEAST_SKEW_NS = 50_000_000
"""Less than this between sending and receiving is the way's, not another clock's."""
FEWEST, MOST = 5, 60
"""Seconds with messages by which a clock is judged."""
SECOND_NS = 1_000_000_000


class SourceClock:
    """Offset of a publisher's clock from this host's.

    Times of sending are read off the publisher's clock, which on another host may be ahead or
    behind. Of the messages of a second, one has nearly no way to go, so the smallest difference
    between receiving and sending tells how far the clocks are apart; the median of some seconds
    does not mind one in which a clock was set, or in which all messages were late.
    """

    def __init__(self) -> None:
        self._smallest: deque[int] = deque(maxlen=MOST)
        self._second = -1

    def add(self, received_ns: int, sent_ns: int, now_ns: int) -> None:
        """Learn from a message.

        Args:
            received_ns: On this host's clock.
            sent_ns: On the publisher's.
            now_ns: On a clock that nobody sets.
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
