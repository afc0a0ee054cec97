"""Puts messages of several topics into the order of their times, whatever the clock does.

Log times are read off a clock that can be set: back by an hour, ahead by years, or not at all as
simulated time before it begins. Messages are only ever moved within one tick of that clock, and
never across the moment at which it was set back.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from bicycle_bag.reader import BagMessage

TICK_NS = 500_000_000
SET_BACK_NS = 10_000_000
"""Less than this between two messages of a topic is no clock that was set back."""
MOST_HELD = 50_000
"""Messages that wait for their turn while a bag is read."""
MOST_HELD_BYTES = 64 * 2**20
"""Largest size of all waiting messages together."""


class _Held(NamedTuple):
    """A message that waits; sorted by how often the clock had been set back, then by time."""

    epoch: int
    log_time_ns: int
    number: int
    message: BagMessage


class Reorder:
    """Holds messages back for one tick, so that each topic's queue may be emptied in one turn.

    Every message received before a tick has been pushed by the next one, so all messages up to the
    newest time known at the last tick can be released in order. No clock is read: a topic whose
    times go back shows that a clock was set back, and each topic's messages keep their order.
    """

    def __init__(self) -> None:
        self._held: list[_Held] = []
        self._newest = (0, 0)
        self._number = 0
        self._epoch = 0
        self._epoch_is_new = False
        self._last: dict[str, tuple[int, int]] = {}

    def push(self, message: BagMessage) -> None:
        """Add a message."""
        time = message.log_time_ns
        epoch, last = self._last.get(message.topic, (self._epoch, time))
        set_back = time < last - SET_BACK_NS
        if set_back and epoch == self._epoch:
            self._epoch += 1
            self._epoch_is_new = True
        if set_back or not self._epoch_is_new:
            last = time if epoch < self._epoch else last
            epoch = self._epoch
        time = max(time, last)
        self._last[message.topic] = epoch, time
        self._number += 1
        self._held.append(_Held(epoch, time, self._number, message))

    def tick(self) -> list[BagMessage]:
        """Return the messages that can be written now, sorted by log time."""
        self._held.sort()
        ready = [held for held in self._held if held[:2] <= self._newest]
        del self._held[: len(ready)]
        if self._held:
            self._newest = self._held[-1][:2]
        self._epoch_is_new = False
        return [held.message for held in ready]

    def rest(self) -> list[BagMessage]:
        """Return all messages still held, sorted."""
        ready = [held.message for held in sorted(self._held)]
        self._held.clear()
        return ready


def by_log_time(messages: Iterable[BagMessage], tick_ns: int = TICK_NS) -> Iterator[BagMessage]:
    """Yield a bag's messages sorted by log time, where they are out of order by less than a tick.

    Messages of one topic keep their order. A message that is older than the newest by more than
    a tick ends the sorting up to there and starts it anew, because the clock was set back or the
    topic has a clock of its own. At most `MOST_HELD` messages of `MOST_HELD_BYTES` are held.
    """
    held: list[tuple[int, int, BagMessage]] = []
    last: dict[str, int] = {}
    newest = size = 0
    for number, message in enumerate(messages):
        time = message.log_time_ns
        if time < newest - tick_ns:
            while held:
                yield heapq.heappop(held)[2]
            newest = size = 0
            last.clear()
        time = max(time, last.get(message.topic, 0))
        last[message.topic] = time
        newest = max(newest, time)
        heapq.heappush(held, (time, number, message))
        size += len(message.data)
        while held and (
            held[0][0] <= newest - tick_ns or len(held) > MOST_HELD or size > MOST_HELD_BYTES
        ):
            ready = heapq.heappop(held)[2]
            size -= len(ready.data)
            yield ready
    while held:
        yield heapq.heappop(held)[2]
