"""Time at which each recorded message is due in a replay."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from typing import NamedTuple, NoReturn

from bicycle_bag.errors import BagError, OptionError
from bicycle_bag.ordering import by_log_time
from bicycle_bag.play_time import PlayTime, with_standing_clocks
from bicycle_bag.reader import BagMessage, BagReader
from bicycle_bag.selection import absolute, with_echoes
from bicycle_common.topic_names import CLOCK

SLOWEST, FASTEST = 1e-4, 1e4
"""Bag seconds per second."""
MOST_TICKS = 10_000.0
"""Hz."""
LONGEST_DELAY = 86_400.0
"""s."""
LONGEST_GAP = 60.0
"""Longest silence of the recording that a replay waits for by default, s of the bag."""
MOST_SECONDS = 1e9
"""Bag seconds, 31 years."""


@dataclass(frozen=True)
class PlayOptions:
    """Options of a replay.

    Args:
        rate: Bag seconds per second.
        start_offset: Bag seconds of playing to leave out at the start.
        topics: Only these; all by default.
        exclude_topics: Not these.
        duration: Bag seconds to play at most, from the start offset on; 0 is to the end.
        clock_hz: How often per second to publish the time of the bag on `/clock` instead of
            the recorded one; 0 never does.
        delay: s before the first message.
        max_gap: Bag seconds of silence to wait for; longer ones are left out.

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
    max_gap: float = LONGEST_GAP

    def __post_init__(self) -> None:
        if not SLOWEST <= self.rate <= FASTEST:
            raise OptionError(
                f"rate is {self.rate}: choose {SLOWEST:g} to {FASTEST:g}, as 2 for twice as fast"
            )
        if not (math.isfinite(self.duration) and self.duration >= 0.0):
            raise OptionError(f"playback duration is {self.duration}: choose more than 0")
        bounds = {
            "start_offset": MOST_SECONDS,
            "clock_hz": MOST_TICKS,
            "delay": LONGEST_DELAY,
            "max_gap": MOST_SECONDS,
        }
        for name, most in bounds.items():
            value = getattr(self, name)
            if not 0.0 <= value <= most:
                raise OptionError(f"{name.replace('_', ' ')} is {value}: choose 0 to {most:g}")


class ClockTick(NamedTuple):
    """A moment at which `/clock` is due; bag time in nanoseconds."""

    log_time_ns: int


class Playback:
    """A bag's messages and when they are due.

    Args:
        reader: The bag.
        options: What to play and how fast.

    Attributes:
        topics: Names of the topics that are played.
        rate: Bag seconds per second.
        duration: Bag seconds to play, without silences that are skipped.
        clock_jumps: True if the recording's clock was set or stopped; both are then estimates.

    Raises:
        BagError: The bag lacks a topic or has no message to play.
    """

    def __init__(self, reader: BagReader, options: PlayOptions) -> None:
        self._reader = reader
        self._options = options
        self.rate = options.rate
        self._skipped_ns = int(options.start_offset * 1e9)
        left_out = {absolute(name) for name in options.exclude_topics}
        chosen = [absolute(name) for name in options.topics] or list(reader.topics)
        reader.require([*chosen, *left_out])
        named = {absolute(name) for name in options.topics} - left_out
        left_out = set(with_echoes(left_out, reader.topics)) - named
        chosen = [n for n in with_echoes(chosen, reader.topics) if n not in left_out]
        self.topics = [name for name in chosen if not (options.clock_hz and name == CLOCK)]
        if not any(reader.counts[name] for name in self.topics):
            raise BagError(f"{reader.path} has no message to play: choose other topics")
        first = next(by_log_time(reader.messages()), None)
        self._start_ns = None if first is None else first.log_time_ns
        self.clock_jumps = False
        whole = self._measure()
        left = max(0.0, whole - options.start_offset)
        self.duration = min(left, options.duration or left)
        if options.start_offset > whole and not self.clock_jumps:
            self._refuse_offset(whole)

    def _refuse_offset(self, seconds: float) -> NoReturn:
        raise OptionError(
            f"the bag lasts {seconds:.1f} s: choose a smaller start offset than "
            f"{self._options.start_offset}"
        )

    def _time(self, tell: Callable[[str], object]) -> PlayTime:
        longest = int(self._options.max_gap * 1e9)
        return PlayTime(longest, tell, self._start_ns)

    def _measure(self) -> float:
        """Bag seconds from the first to the last message, by the index."""

        def jumped(_: str) -> None:
            self.clock_jumps = True

        time = self._time(jumped)
        for moment in self._reader.moments(int(self._options.max_gap * 1e9)):
            time.due(BagMessage("", "", moment, 0, b""))
        self.clock_jumps = self.clock_jumps or time.now_ns == 0
        return time.now_ns / 1e9

    def timeline(
        self, tell: Callable[[str], object] = lambda _: None
    ) -> Iterator[tuple[float, BagMessage | ClockTick]]:
        """Yield each message or clock tick with its time after the start of the replay, s.

        Messages come in recorded order but for small disorder, see `ordering.by_log_time`.

        Args:
            tell: Called with one line for each jump of the recording's clock.

        Raises:
            BagError: The bag is corrupt where it is being read, or nothing is due from the start
                offset on or within the playback duration.
        """
        time = self._time(tell)
        period = int(1e9 * self.rate / self._options.clock_hz) if self._options.clock_hz else 0
        next_tick, played = self._skipped_ns, False
        recorded = by_log_time(self._reader.messages(self.topics))
        for message, clock_stands in with_standing_clocks(recorded):
            offset = time.offset_ns
            due = time.due(message, clock_stands)
            if due < self._skipped_ns:
                continue
            if self._options.duration and due - self._skipped_ns > self._options.duration * 1e9:
                if not played:
                    raise BagError(
                        f"nothing of it is due within {self._options.duration:g} s after the "
                        "start offset: choose a longer playback duration"
                    )
                return
            offset = offset if played else time.offset_ns
            while period and next_tick <= due:
                yield self._seconds(next_tick), ClockTick(max(0, next_tick + offset))
                next_tick += period
            played = True
            yield self._seconds(due), message
        if not played:
            raise BagError(
                f"the last of what is to be played is due after {time.now_ns / 1e9:.1f} s: "
                f"choose a smaller start offset than {self._options.start_offset}"
            )

    def _seconds(self, due: int) -> float:
        """Return the time after the start of the replay at which something is due, s."""
        return (due - self._skipped_ns) / 1e9 / self.rate
