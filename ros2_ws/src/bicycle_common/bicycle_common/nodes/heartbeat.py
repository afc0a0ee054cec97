"""A file that a node touches while it serves its callbacks, for whoever watches over it."""

from __future__ import annotations

import os
import time
from pathlib import Path

VARIABLE = "BICYCLE_HEARTBEAT"
PERIOD = 1.0
"""s between two touches."""


class Heartbeat:
    """Touches the file that BICYCLE_HEARTBEAT names; does nothing without that variable.

    A supervisor compares the file's age, which costs the loop nothing; a check that joins the ROS
    graph would take a core for half a second each time.

    Raises:
        OSError: the file cannot be written.
    """

    def __init__(self) -> None:
        named = os.environ.get(VARIABLE, "")
        self._path = Path(named) if named else None
        self._next = 0.0
        self.beat()

    def beat(self) -> None:
        """Touch the file if the last time was a second ago."""
        if self._path is not None and time.monotonic() >= self._next:
            self._next = time.monotonic() + PERIOD
            self._path.touch()
