"""Puts messages of several topics into the order of their times as they come."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from bicycle_bag.metadata import NO_START
from bicycle_bag.reader import BagMessage

TICK_NS = 500_000_000
# A bag whose times run backwards must not pile up in memory.
MOST_HELD = 50_000


class Reorder:
    """Holds messages back for one tick, so that each topic's queue may be emptied at one go.

    What was received before the last tick has been pushed by the next, so all up to the newest
    time known at the last tick can go on, sorted. No clock is asked, so none can jump.
    """

    def __init__(self) -> None:
        self._held: list[BagMessage] = []
        self._newest = 0

    def push(self, message: BagMessage) -> None:
        """Take a message."""
        self._held.append(message)

    def tick(self) -> list[BagMessage]:
        """Messages that can be written now, sorted by log time."""
        self._held.sort(key=_log_time)
        ready = [message for message in self._held if message.log_time_ns <= self._newest]
        del self._held[: len(ready)]
        if self._held:
            self._newest = self._held[-1].log_time_ns
        return ready

    def rest(self) -> list[BagMessage]:
        """All that is still held, sorted."""
        self._newest = NO_START
        return self.tick()


def _log_time(message: BagMessage) -> int:
    return message.log_time_ns


def by_log_time(
    messages: Iterable[BagMessage], tick_ns: int = 500_000_000
) -> Iterator[BagMessage]:
    """Messages of a bag in order of log time, where they are out of it by less than a tick."""
    order = Reorder()
    next_tick = None
    for message in messages:
        if next_tick is None or message.log_time_ns >= next_tick:
            yield from order.tick()
            next_tick = message.log_time_ns + tick_ns
        order.push(message)
    yield from order.rest()
