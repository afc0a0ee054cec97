"""Closes a bag on a disk that may be slow, and reports the wait."""

from __future__ import annotations

import contextlib
import sys
import threading
import time

from bicycle_bag.errors import BagError
from bicycle_bag.metadata import BagMetadata
from bicycle_bag.writer import BagWriter
from bicycle_common.signals import StopRequest

FIRST_WORD, NEXT_WORD = 1.0, 10.0
"""Wait before the first message about a slow disk, and between messages (s)."""
LOOK = 0.05
"""Polling period of signals (s)."""


class LeftError(Exception):
    """The user did not wait for the disk; the text names the consequence."""


class Closing(threading.Thread):
    """Runs `BagWriter.close`, so that the main thread can answer signals on a disk that hangs."""

    def __init__(self, writer: BagWriter) -> None:
        super().__init__(name="close", daemon=True)
        self.bag: BagMetadata | None = None
        self.error: BagError | None = None
        self._writer = writer

    def run(self) -> None:
        """Close the bag; the result is in `bag` or `error`."""
        try:
            self.bag = self._writer.close()
        except BagError as error:
            self.error = error


def close(writer: BagWriter, stop: StopRequest, name: str) -> BagMetadata:
    """Close the bag, for as long as the disk takes.

    Args:
        writer: writer of the bag.
        stop: its second SIGINT leaves the rest to the kernel, after a message about the wait and
            once the kernel has everything.
        name: name of the bag, for people.

    Raises:
        BagError: The disk fails.
        LeftError: The user did not wait.
    """
    closing = Closing(writer)
    closing.start()
    began = time.monotonic()
    next_word = FIRST_WORD
    while closing.is_alive():
        closing.join(LOOK)
        waited = time.monotonic() - began
        if waited > next_word and closing.is_alive():
            next_word = waited + NEXT_WORD
            stop.interrupts = 0  # a Ctrl-C from before this line does not answer it
            say(f"still writing {name}: the disk is slow, waiting ({waited:.0f} s so far)")
        elif stop.interrupts and waited > FIRST_WORD:
            stop.interrupts = 0
            if writer.leave():
                raise LeftError(
                    f"not waiting for the disk: {name} is whole unless the power fails before "
                    "the system has written it; the command sync waits for that"
                )
            say(f"{name} would lose messages if it were left now: waiting for the disk")
    if closing.error is not None:
        raise closing.error
    assert closing.bag is not None
    return closing.bag


def say(text: str) -> None:
    """Print a line on standard error, which may be closed if the terminal is gone."""
    with contextlib.suppress(OSError):
        print(f"record.sh: {text}", file=sys.stderr, flush=True)
