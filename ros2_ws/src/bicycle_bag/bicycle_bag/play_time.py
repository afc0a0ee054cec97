"""Conversion of a recording's clock to seconds of playing, also where that clock is unreliable.

Log times may go back by an hour, ahead by years, or stand still; one topic may have its own
clock. Only the order of the messages is reliable, and differences of log times where they are
plausible: the offset between a topic's clock and the time of playing paces that topic. If no
known offset fits, playing uses the time between two publications, or none, and reports the jump.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise

from bicycle_bag.ordering import MOST_HELD_BYTES, TICK_NS
from bicycle_bag.reader import BagMessage

STILL_NS = 1_000_000_000
STILL_MESSAGES = 10
"""Messages of a topic with one log time, published over more than STILL_NS, of a stopped clock.

In simulated time all messages of a step have one log time, although that clock runs.
"""
MOST_IN_A_RUN = 10_000
"""Largest number of messages of one log time that are examined together."""
MOST_OFFSETS = 8
"""Clocks that are remembered besides each topic's own."""
SECOND = 1_000_000_000


class PlayTime:
    """Tells when each message is due; call `due` once for each, in the order of playing.

    Args:
        longest_gap_ns: A silence that is waited for; a longer one is a jump of the clock.
        tell: Called with one line for each jump.
        start_ns: Log time at which the recording begins; that of the first message by default.

    Attributes:
        now_ns: Time of playing of the last message.
    """

    def __init__(
        self,
        longest_gap_ns: int,
        tell: Callable[[str], object] = lambda _: None,
        start_ns: int | None = None,
    ) -> None:
        self.now_ns = 0
        self._longest = longest_gap_ns
        self._tell = tell
        self._offsets: list[int] = [] if start_ns is None else [start_ns]
        self._own: dict[str, int] = {}
        self._published: dict[str, tuple[int, int]] = {}
        self._still: int | None = None

    @property
    def offset_ns(self) -> int:
        """Log time less time of playing, of the clock that was followed last."""
        return self._offsets[0] if self._offsets else 0

    def due(self, message: BagMessage, clock_stands: bool = False) -> int:
        """Return when a message is due, in ns of playing.

        Args:
            message: The next one.
            clock_stands: True if its log time says nothing.
        """
        step = self._publishing_step(message)
        if clock_stands:
            self._say_still(message)
            self._anchor(message, self.now_ns + step)
            return self._note(message)
        self._still = None
        own = self._own.get(message.topic)
        for offset in self._offsets if own is None else [own, *self._offsets]:
            ahead = message.log_time_ns - offset - self.now_ns
            if -TICK_NS <= ahead <= self._longest:
                self._follow(message.topic, offset)
                self.now_ns += max(0, ahead)
                return self._note(message)
        if self._offsets:
            self._say_jump(message, step)
        self._anchor(message, self.now_ns + step)
        return self._note(message)

    def _note(self, message: BagMessage) -> int:
        """Remember when a topic's message was published and is played; returns the latter."""
        self._published[message.topic] = message.publish_time_ns, self.now_ns
        return self.now_ns

    def _publishing_step(self, message: BagMessage) -> int:
        """Return the time until the message is due by its topic's publish times, ns; else 0."""
        published, played = self._published.get(message.topic, (message.publish_time_ns, 0))
        passed = message.publish_time_ns - published
        return max(0, played + passed - self.now_ns) if 0 <= passed <= self._longest else 0

    def _follow(self, topic: str, offset: int) -> None:
        self._own[topic] = offset
        if not self._offsets or self._offsets[0] != offset:
            rest = [known for known in self._offsets if known != offset]
            self._offsets = [offset, *rest][:MOST_OFFSETS]

    def _anchor(self, message: BagMessage, now_ns: int) -> None:
        """Let this message be due at a time of playing, and go on from there."""
        self.now_ns = now_ns
        self._follow(message.topic, message.log_time_ns - now_ns)

    def _say_jump(self, message: BagMessage, step: int) -> None:
        ahead = message.log_time_ns - self._offsets[0] - self.now_ns
        where = f"after {self.now_ns / SECOND:.1f} s, at a message of {message.topic}"
        waited = f"played on after {step / SECOND:.1f} s"
        if ahead < 0:
            self._tell(f"the recording's clock goes back by {span(-ahead)} {where}: {waited}")
        else:
            self._tell(
                f"nothing was recorded for {span(ahead)} or the clock was set ahead {where}: "
                f"{waited}; --max-gap waits for longer silences than {span(self._longest)}"
            )

    def _say_still(self, message: BagMessage) -> None:
        if self._still != message.log_time_ns:
            self._still = message.log_time_ns
            self._tell(
                f"the recording's clock stands still after {self.now_ns / SECOND:.1f} s: paced by "
                "the times of publishing"
            )


def span(nanoseconds: int) -> str:
    """Return a duration as text."""
    seconds = nanoseconds / SECOND
    for unit, length in (("years", 31_557_600.0), ("days", 86_400.0), ("hours", 3600.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.1f} {unit}"
    return f"{seconds:.1f} s"


def with_standing_clocks(messages: Iterable[BagMessage]) -> Iterator[tuple[BagMessage, bool]]:
    """Yield each message, and True if it is one of many with the same log time."""
    run: list[BagMessage] = []
    stands, size = False, 0
    for message in messages:
        ended = bool(run) and message.log_time_ns != run[-1].log_time_ns
        if ended or len(run) >= MOST_IN_A_RUN or size > MOST_HELD_BYTES:
            stands = stands or _published_on(run)
            yield from ((held, stands) for held in run)
            stands, size = stands and not ended, 0
            run = []
        run.append(message)
        size += len(message.data)
    stands = stands or _published_on(run)
    yield from ((held, stands) for held in run)


def _published_on(run: list[BagMessage]) -> bool:
    """Return True if a topic was published on and on under one log time."""
    times = defaultdict(list)
    for message in run:
        times[message.topic].append(message.publish_time_ns)
    return any(
        len(found) >= STILL_MESSAGES
        and found[-1] - found[0] > STILL_NS
        and all(before <= after for before, after in pairwise(found))
        for found in times.values()
    )
