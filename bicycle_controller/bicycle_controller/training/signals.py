"""Clean interruption by Ctrl-C and SIGTERM, at the next pause or at once."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any


class InterruptError(Exception):
    """Raised inside `StopRequest.at_once` when a signal comes."""


class StopRequest:
    """Catches the first SIGINT or SIGTERM; a second one acts as without it.

    Only the main thread can catch signals; in another this does nothing.

    Attributes:
        signal: number of the signal that came; 0 until then.
    """

    def __init__(self) -> None:
        self.signal = 0
        self._raises = False
        self._old: dict[int, Any] = {}

    def __enter__(self) -> StopRequest:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._old[number] = signal.signal(number, self._take)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._restore()

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Let a signal raise `InterruptError` in this context instead of waiting for a check.

        Raises:
            InterruptError: if a signal comes, or has come.
        """
        self._raises = True
        try:
            if self.signal:
                raise InterruptError
            yield
        finally:
            self._raises = False

    def _take(self, number: int, frame: FrameType | None) -> None:
        self.signal = number
        self._restore()
        if self._raises:
            raise InterruptError

    def _restore(self) -> None:
        for number, old in self._old.items():
            signal.signal(number, old)
        self._old = {}
