"""Queues of data for each page, and their limits for a page that is too slow.

All methods belong to the server's event loop and must not be called from another thread.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Sequence

from bicycle_cockpit.rows import Rows, joined

MOST_FRAMES = 500
"""Largest number of frames queued for a page: 20 s, sent at once when it reads again."""
MOST_RELIABLE = 1_000
"""Largest number of answers and events queued for a page; with more it is disconnected."""
MOST_CLIENTS = 16
LASTING = ("palette", "fleet")
"""Types of data that are the same for every ride."""


class TooSlowError(Exception):
    """A page does not read any more."""


class Outbox:
    """Queue of one page.

    Attributes:
        dropped: number of frames that it never received.
    """

    def __init__(self) -> None:
        self.dropped = 0
        self._frames: deque[Rows] = deque()
        self._history: deque[Rows] = deque()
        self._reliable: deque[str] = deque()
        self._latest: dict[str, str] = {}
        self._something = asyncio.Event()
        self._full = False
        self._greeted = False

    def greet(self, text: str, history: Sequence[Rows]) -> None:
        """Queue the first message of a page, and all rows until now, the newest ones first."""
        self._greeted = True
        self._reliable.appendleft(text)
        self._history.extend(history)
        self._something.set()

    def begin_anew(self, text: str, history: Sequence[Rows]) -> None:
        """Queue another greeting, and drop what has not been sent of the ride before.

        What must not be lost is sent first. A page that waits for its first greeting gets it from
        `greet`.
        """
        self._frames.clear()
        self._history.clear()
        for kind in set(self._latest) - set(LASTING):
            del self._latest[kind]
        if self._greeted:
            self._reliable.append(text)
            self._history.extend(history)
            self._something.set()

    def stream(self, rows: Rows) -> None:
        """Queue new rows; before the greeting they are in the history already."""
        if not self._greeted:
            return
        if self._frames and self._frames[-1].ride != rows.ride:
            self._history.clear()
            self._frames.clear()  # from before a restart of the simulator
        if len(self._frames) >= MOST_FRAMES:
            self._frames.popleft()
            self.dropped += 1
        self._frames.append(rows)
        self._something.set()

    def latest(self, kind: str, text: str) -> None:
        """Queue data of which only the newest matters."""
        self._latest[kind] = text
        self._something.set()

    def reliable(self, text: str) -> None:
        """Queue data that must not be lost."""
        if len(self._reliable) >= MOST_RELIABLE:
            self._full = True
        else:
            self._reliable.append(text)
        self._something.set()

    async def take(self) -> str:
        """Return the next data to send: greeting, reliable data, latest data, frames, old rows.

        Raises:
            TooSlowError: if too many reliable messages are queued.
        """
        while True:
            if self._full:
                raise TooSlowError
            if self._greeted and (text := self._next()):
                return text
            self._something.clear()
            await self._something.wait()

    def _next(self) -> str:
        """Return the next data to send; empty if there are none."""
        if self._reliable:
            return self._reliable.popleft()
        if self._latest:
            return self._latest.pop(next(iter(self._latest)))
        if self._frames:
            waiting = joined(self._frames)
            self._frames.clear()
            return waiting.message("frame")
        return self._history.popleft().message("history") if self._history else ""


class Broadcaster:
    """Queues of all pages, by number."""

    def __init__(self) -> None:
        self._boxes: dict[int, Outbox] = {}
        self._next = 1
        self._last: dict[str, str] = {}

    @property
    def count(self) -> int:
        """Number of connected pages."""
        return len(self._boxes)

    @property
    def dropped(self) -> int:
        """Number of frames that the connected pages never received."""
        return sum(box.dropped for box in self._boxes.values())

    def join(self) -> tuple[int, Outbox] | None:
        """Return a new page's number and queue; None if there are too many pages."""
        if len(self._boxes) >= MOST_CLIENTS:
            return None
        number, box = self._next, Outbox()
        self._next += 1
        self._boxes[number] = box
        for kind, text in self._last.items():
            box.latest(kind, text)
        return number, box

    def leave(self, number: int) -> None:
        """Remove a page."""
        self._boxes.pop(number, None)

    def greet(self, number: int, text: str, history: Sequence[Rows]) -> None:
        """Queue a page's greeting; see `Outbox.greet`."""
        if number in self._boxes:
            self._boxes[number].greet(text, history)

    def begin_anew(self, text: str, history: Sequence[Rows]) -> None:
        """Queue a greeting for another ride for all pages; see `Outbox.begin_anew`."""
        self._last = {kind: data for kind, data in self._last.items() if kind in LASTING}
        for box in self._boxes.values():
            box.begin_anew(text, history)

    def stream(self, rows: Rows) -> None:
        """Queue new rows for all pages."""
        for box in self._boxes.values():
            box.stream(rows)

    def latest(self, kind: str, text: str) -> None:
        """Queue data of which only the newest matters, for all present and later pages."""
        self._last[kind] = text
        for box in self._boxes.values():
            box.latest(kind, text)

    def reliable(self, text: str, to: int | None = None) -> None:
        """Queue data that must not be lost, for one page or for all."""
        for number, box in self._boxes.items():
            if to is None or number == to:
                box.reliable(text)
