"""Messages of one publisher that several subscriptions receive: each once, in order, counted."""

from __future__ import annotations

import bisect
from typing import Generic, TypeVar

MOST_AHEAD = 10_000
"""Messages of a publisher that wait for earlier ones."""
MOST_GAPS = 1000
"""Gaps that may still be filled; what is missing in older ones is lost for good."""

Message = TypeVar("Message")


class Numbering:
    """Numbers that a publisher gave its messages: which have come, and which are missing.

    Attributes:
        last: highest number that has come; 0 before the first.
        missing: count of the numbers between the lowest and the highest that have not come.
    """

    def __init__(self) -> None:
        self.last = self.missing = 0
        self._first = 0
        self._gaps: list[range] = []

    def take(self, number: int) -> bool:
        """Note that a message has come; return False if it had come before."""
        if not self.last:
            self._first = self.last = number
        elif number > self.last:
            self._skip(len(self._gaps), range(self.last + 1, number))
            self.last = number
        elif number < self._first:
            self._skip(0, range(number + 1, self._first))
            self._first = number
        else:
            return self._fill(number)
        return True

    def _skip(self, index: int, gap: range) -> None:
        self.missing += len(gap)
        self._gaps[index:index] = [gap] if gap else []
        del self._gaps[:-MOST_GAPS]

    def _fill(self, number: int) -> bool:
        """Take a number out of its gap; return False if it is in none."""
        index = bisect.bisect(self._gaps, number, key=lambda gap: gap.start) - 1
        if index < 0 or number not in self._gaps[index]:
            return False
        gap = self._gaps[index]
        parts = range(gap.start, number), range(number + 1, gap.stop)
        self._gaps[index : index + 1] = [part for part in parts if part]
        self.missing -= 1
        return True


class Stream(Generic[Message]):
    """One publisher's messages, from all subscriptions that it reaches.

    The subscription with just the publisher's quality loses least, and receives in order. Others
    may be ahead of it: a best-effort one skips what is lost on the way, and a reliable one gets
    that again later, also after it has lost the publisher and met it again. What others receive
    therefore waits until the publisher's own subscription has come as far, and fills its gaps.
    """

    def __init__(self) -> None:
        self._numbering = Numbering()
        self._ahead: dict[int, Message] = {}

    @property
    def last(self) -> int:
        """Highest number among the messages that were returned."""
        return self._numbering.last

    @property
    def lost(self) -> int:
        """Count of the messages between the first and the last one that never came."""
        return self._numbering.missing

    def take(self, number: int, message: Message, own: bool) -> list[Message]:
        """Return the messages that are due now, by number.

        Args:
            number: that the publisher gave the message.
            message: that has come.
            own: True if it came by the publisher's own subscription.
        """
        if not own and number > self._numbering.last:
            self._ahead.setdefault(number, message)
            return self._until(min(self._ahead)) if len(self._ahead) > MOST_AHEAD else []
        earlier = self._until(number - 1) if self._ahead else []
        self._ahead.pop(number, None)
        return [*earlier, message] if self._numbering.take(number) else earlier

    def rest(self) -> list[Message]:
        """Return the messages that still wait, by number."""
        return self._until(max(self._ahead, default=0))

    def _until(self, last: int) -> list[Message]:
        numbers = sorted(number for number in self._ahead if number <= last)
        due = [(number, self._ahead.pop(number)) for number in numbers]
        return [message for number, message in due if self._numbering.take(number)]
