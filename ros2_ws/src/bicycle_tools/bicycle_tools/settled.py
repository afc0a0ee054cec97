"""Waiting for what becomes known bit by bit, as nodes on a busy machine do."""

from __future__ import annotations

import time
from collections.abc import Callable


class Settled:
    """Condition that holds once what is seen has not changed for a while.

    Args:
        look: returns what is seen.
        quiet: s.
        clock: steady, s.
    """

    def __init__(
        self,
        look: Callable[[], object],
        quiet: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._look, self._quiet, self._clock = look, quiet, clock
        self._seen, self._since = look(), clock()

    def __call__(self) -> bool:
        """Look again; return True if it has not changed for so long."""
        seen, now = self._look(), self._clock()
        if seen != self._seen:
            self._seen, self._since = seen, now
        return now - self._since >= self._quiet
