"""When each recorded message is due in a replay."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import NamedTuple

from bicycle_bag.errors import BagError
from bicycle_bag.ordering import by_log_time
from bicycle_bag.reader import BagMessage, BagReader
from bicycle_bag.selection import absolute

CLOCK = "/clock"
SLOWEST, FASTEST = 1e-4, 1e4
"""Bag seconds per second."""
MOST_TICKS = 10_000.0
"""Hz."""
LONGEST_DELAY = 86_400.0
"""s."""


@dataclass(frozen=True)
class PlayOptions:
    """How to replay.

    Args:
        rate: Bag seconds per second.
        start_offset: Bag seconds to leave out at the start.
        topics: Only these; all by default.
        exclude_topics: Not these.
        duration: Bag seconds to play at most, from the start offset on; 0 is to the end.
        clock_hz: How often per second to publish the time of the bag on ``/clock`` instead of
            the recorded one; 0 never does.
        delay: s before the first message.

    Raises:
        BagError: A value is out of range.
    """

    rate: float = 1.0
    start_offset: float = 0.0
    topics: Collection[str] = ()
    clock_hz: float = 0.0
    delay: float = 0.0
    exclude_topics: Collection[str] = ()
    duration: float = 0.0

    def __post_init__(self) -> None:
        if not SLOWEST <= self.rate <= FASTEST:
            raise BagError(
                f"rate is {self.rate}: choose {SLOWEST:g} to {FASTEST:g}, as 2 for twice as fast"
            )
        if not (math.isfinite(self.start_offset) and self.start_offset >= 0.0):
            raise BagError(f"start offset is {self.start_offset}: choose 0 or more")
        if not (math.isfinite(self.duration) and self.duration >= 0.0):
            raise BagError(f"playback duration is {self.duration}: choose more than 0")
        for name, most in (("clock_hz", MOST_TICKS), ("delay", LONGEST_DELAY)):
            value = getattr(self, name)
            if not 0.0 <= value <= most:
                raise BagError(f"{name.replace('_', ' ')} is {value}: choose 0 to {most:g}")


class ClockTick(NamedTuple):
    """A moment at which ``/clock`` is due; bag time in nanoseconds."""

    log_time_ns: int


class Playback:
    """A bag's messages and when they are due.

    Args:
        reader: The bag.
        options: What to play and how fast.

    Raises:
        BagError: The bag lacks a topic or has no message to play.
    """

    def __init__(self, reader: BagReader, options: PlayOptions) -> None:
        self._reader = reader
        self._options = options
        left_out = {absolute(name) for name in options.exclude_topics}
        chosen = [absolute(name) for name in options.topics] or list(reader.topics)
        reader.require([*chosen, *left_out])
        chosen = [name for name in chosen if name not in left_out]
        self.topics = [name for name in chosen if not (options.clock_hz and name == CLOCK)]
        if not any(reader.counts[name] for name in self.topics):
            raise BagError(f"{reader.path} has no message to play: choose other topics")
        if options.start_offset * 1e9 > reader.duration_ns:
            raise BagError(
                f"the bag lasts {reader.duration_ns / 1e9:.1f} s: choose a smaller start offset "
                f"than {options.start_offset}"
            )
        self._start_ns = reader.starting_time_ns + int(options.start_offset * 1e9)

    @property
    def duration(self) -> float:
        """Bag seconds to play."""
        whole = self._reader.duration_ns / 1e9 - self._options.start_offset
        return min(whole, self._options.duration or whole)

    def bag_seconds(self, item: BagMessage | ClockTick) -> float:
        """Bag seconds from the start of the replay to an item of the timeline."""
        return (item.log_time_ns - self._start_ns) / 1e9

    def timeline(self) -> Iterator[tuple[float, BagMessage | ClockTick]]:
        """Each message or clock tick with its time in s after the start of the replay."""
        rate = self._options.rate
        tick_ns = int(1e9 * rate / self._options.clock_hz) if self._options.clock_hz else 0
        next_tick = self._start_ns
        for message in by_log_time(self._reader.messages(self.topics)):
            if message.log_time_ns < self._start_ns:
                continue
            if self._options.duration and self.bag_seconds(message) > self._options.duration:
                break
            while tick_ns and next_tick <= message.log_time_ns:
                tick = ClockTick(next_tick)
                yield self.bag_seconds(tick) / rate, tick
                next_tick += tick_ns
            yield self.bag_seconds(message) / rate, message
