"""What waits to be sent to each page. A page that does not keep up loses the oldest frames.

All of it belongs to the server's event loop: nothing here is called from another thread.
"""

from __future__ import annotations

import asyncio
from collections import deque

MOST_FRAMES = 8
"""That wait for one page: a third of a second."""
MOST_LETTERS = 100
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
        self._frames: deque[str] = deque()
        self._letters: deque[str] = deque()
        self._newest: dict[str, str] = {}
        self._something = asyncio.Event()
        self._full = False
        self._greeted = False

    def frame(self, text: str) -> None:
        """A frame, which may be lost; what comes before the greeting is in that already."""
        if not self._greeted:
            return
        if len(self._frames) >= MOST_FRAMES:
            self._frames.popleft()
            self.dropped += 1
        self._frames.append(text)
        self._something.set()

    def newest(self, kind: str, text: str) -> None:
        """Something of which only the newest matters."""
        self._newest[kind] = text
        self._something.set()

    def letter(self, text: str, own: bool = True) -> None:
        """Something that must not be lost; the first of a page's own is its greeting."""
        self._greeted |= own
        if len(self._letters) >= MOST_LETTERS:
            self._full = True
        else:
            self._letters.append(text)
        self._something.set()

    async def take(self) -> str:
        """What is to be sent next: letters, then what is new, then frames.

        Raises:
            TooSlowError: when too many letters wait.
        """
        while True:
            if self._full:
                raise TooSlowError
            if self._letters:
                return self._letters.popleft()
            if self._newest:
                return self._newest.pop(next(iter(self._newest)))
            if self._frames:
                return self._frames.popleft()
            self._something.clear()
            await self._something.wait()


class Hub:
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
        """A new page's number and outbox; None where there are too many."""
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

    def frame(self, text: str) -> None:
        """A frame for all."""
        for box in self._boxes.values():
            box.frame(text)

    def newest(self, kind: str, text: str) -> None:
        """Something of which only the newest matters, for all, and for those who come later."""
        self._last[kind] = text
        for box in self._boxes.values():
            box.newest(kind, text)

    def letter(self, text: str, to: int | None = None) -> None:
        """Something that must not be lost, for one page or for all."""
        for number, box in self._boxes.items():
            if to is None or number == to:
                box.letter(text, own=to is not None)
