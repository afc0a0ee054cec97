"""Log of the web server: one line per event, with a rate limit."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Iterator, Sequence

from bicycle_cockpit.rate_limiter import RateLimiter

LONGEST = 300
"""Longest line in characters; a client can choose a line's length."""
RATE, BURST = 1.0, 20.0
"""Lines per second, and at once."""


class OneLine:
    """Passes lines on, with a rate limit.

    Args:
        say: logs a line; called in the thread that logs.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._rate_limiter = RateLimiter(RATE, BURST)
        self._unsaid = 0

    def __call__(self, line: str) -> None:
        """Log a line."""
        if not self._rate_limiter.take():
            self._unsaid += 1
            return
        more = f" (and {self._unsaid} more lines before)" if self._unsaid else ""
        self._unsaid = 0
        kept = line if len(line) <= LONGEST else f"{line[:LONGEST]}..."
        self._say("".join(char if char.isprintable() else "?" for char in kept) + more)


class ToOneLine(logging.Handler):
    """Handler that logs a library's records, with any traceback, as one line."""

    def __init__(self, log: OneLine) -> None:
        super().__init__(logging.WARNING)
        self._log = log

    def emit(self, record: logging.LogRecord) -> None:
        """Log the message and the exception's text."""
        text = " ".join(record.getMessage().split())
        error = record.exc_info[1] if record.exc_info else None
        if error is not None:
            words = " ".join(str(error).split())
            text += f" ({type(error).__name__}: {words})"
        self._log(text)


@contextlib.contextmanager
def listened_to(log: OneLine, names: Sequence[str]) -> Iterator[None]:
    """Log what the loggers of these names say, within this context, as lines of `log`."""
    handler = ToOneLine(log)
    loggers = [logging.getLogger(name) for name in names]
    for logger in loggers:
        logger.addHandler(handler)
    try:
        yield
    finally:
        for logger in loggers:
            logger.removeHandler(handler)
