"""File that a node touches while it serves its callbacks, for a supervisor."""

from __future__ import annotations

import os
import time
from pathlib import Path

VARIABLE = "BICYCLE_HEARTBEAT"
PERIOD = 1.0
"""Time between two touches (s)."""


class Heartbeat:
    """Touches the file named by BICYCLE_HEARTBEAT; does nothing without that variable.

    A supervisor reads the file's age, which costs the loop nothing; a check that joins the ROS
    graph would use a core for half a second each time.

    Raises:
        OSError: if the file cannot be written.
    """

    def __init__(self) -> None:
        named = os.environ.get(VARIABLE, "")
        self._path = Path(named) if named else None
        self._next = 0.0
        self.beat()

    def beat(self) -> None:
        """Touch the file if the last touch was a second ago."""
        if self._path is not None and time.monotonic() >= self._next:
            self._next = time.monotonic() + PERIOD
            self._path.touch()
