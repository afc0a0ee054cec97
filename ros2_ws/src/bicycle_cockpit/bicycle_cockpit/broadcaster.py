"""What waits to be sent to each page, and what a page loses that does not keep up.

All of it belongs to the server's event loop: nothing here is called from another thread.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Sequence

from bicycle_cockpit.rows import Rows, joined

MOST_FRAMES = 500
"""That wait for one page: 20 s, which a page gets in one go when it takes something again."""
MOST_LETTERS = 1_000
"""Answers and events that wait for one page; with more it is given up."""
MOST_CLIENTS = 16


class TooSlowError(Exception):
    """A page takes nothing any more."""


class Outbox:
    """What one page is still to get.

    Attributes:
        dropped: frames that it never got.
    """

    def __init__(self) -> None:
        self.dropped = 0
        self._frames: deque[Rows] = deque()
        self._history: deque[Rows] = deque()
        self._letters: deque[str] = deque()
        self._newest: dict[str, str] = {}
        self._something = asyncio.Event()
        self._full = False
        self._greeted = False

    def greet(self, text: str, history: Sequence[Rows]) -> None:
        """The first thing a page gets, and all rows until now, the newest ones first."""
        self._greeted = True
        self._letters.appendleft(text)
        self._history.extend(history)
        self._something.set()

    def frame(self, rows: Rows) -> None:
        """New rows; what comes before the greeting is in the history already."""
        if not self._greeted:
            return
        if self._frames and self._frames[-1].ride != rows.ride:
            self._history.clear()
            self._frames.clear()  # of a simulator that was started anew since
        if len(self._frames) >= MOST_FRAMES:
            self._frames.popleft()
            self.dropped += 1
        self._frames.append(rows)
        self._something.set()

    def newest(self, kind: str, text: str) -> None:
        """Something of which only the newest matters."""
        self._newest[kind] = text
        self._something.set()

    def letter(self, text: str) -> None:
        """Something that must not be lost."""
        if len(self._letters) >= MOST_LETTERS:
            self._full = True
        else:
            self._letters.append(text)
        self._something.set()

    async def take(self) -> str:
        """What is to be sent next: the greeting, letters, what is new, frames, old rows.

        Raises:
            TooSlowError: when too many letters wait.
        """
        while True:
            if self._full:
                raise TooSlowError
            if self._greeted and (text := self._next()):
                return text
            self._something.clear()
            await self._something.wait()

    def _next(self) -> str:
        """What is to be sent next; nothing where nothing waits."""
        if self._letters:
            return self._letters.popleft()
        if self._newest:
            return self._newest.pop(next(iter(self._newest)))
        if self._frames:
            waiting = joined(self._frames)
            self._frames.clear()
            return waiting.message("frame")
        return self._history.popleft().message("history") if self._history else ""


class Broadcaster:
    """The outboxes of all pages, by number."""

    def __init__(self) -> None:
        self._boxes: dict[int, Outbox] = {}
        self._next = 1
        self._last: dict[str, str] = {}

    @property
    def count(self) -> int:
        """Pages that are connected."""
        return len(self._boxes)

    @property
    def dropped(self) -> int:
        """Frames that pages which are connected never got."""
        return sum(box.dropped for box in self._boxes.values())

    def join(self) -> tuple[int, Outbox] | None:
        """Return a new page's number and outbox; None where there are too many."""
        if len(self._boxes) >= MOST_CLIENTS:
            return None
        number, box = self._next, Outbox()
        self._next += 1
        self._boxes[number] = box
        for kind, text in self._last.items():
            box.newest(kind, text)
        return number, box

    def leave(self, number: int) -> None:
        """A page is gone."""
        self._boxes.pop(number, None)

    def greet(self, number: int, text: str, history: Sequence[Rows]) -> None:
        """A page's greeting; see `Outbox.greet`."""
        if number in self._boxes:
            self._boxes[number].greet(text, history)

    def frame(self, rows: Rows) -> None:
        """New rows for all."""
        for box in self._boxes.values():
            box.frame(rows)

    def newest(self, kind: str, text: str) -> None:
        """Something of which only the newest matters, for all, and for those who come later."""
        self._last[kind] = text
        for box in self._boxes.values():
            box.newest(kind, text)

    def letter(self, text: str, to: int | None = None) -> None:
        """Something that must not be lost, for one page or for all."""
        for number, box in self._boxes.items():
            if to is None or number == to:
                box.letter(text)
