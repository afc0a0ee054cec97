"""A recorder that pages may start and end: the same process that record.sh runs."""

from __future__ import annotations

import threading
import time
from pathlib import Path

from bicycle_bringup.processes import Child, registry_of
from bicycle_bringup.ride_options import program, workspace


class Recording:
    """At most one recorder at a time, into the folder of the bags."""

    def __init__(self, folder: Path, logs: Path) -> None:
        """Record into `folder`; what the recorder prints goes to a log in `logs`."""
        self._folder, self._logs = folder, logs
        self._child: Child | None = None
        self._ending: threading.Thread | None = None
        self.name = ""
        """Of the bag being recorded; empty while none is."""

    def start(self) -> tuple[bool, str]:
        """Begin a new bag; whether it could, and a line about it."""
        if self._child is not None:
            return False, f"{self.name} is being recorded already"
        name = time.strftime("bag-%Y-%m-%d-%H%M%S")
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            command = [*program("recorder"), "--output", str(self._folder / name)]
            child = Child(
                "recorder", command, self._logs / "recorder.log", registry_of(workspace())
            )
            child.start()
        except OSError as error:
            return False, f"cannot record into {self._folder}: {error.strerror}"
        self._child, self.name = child, name
        return True, f"recording {name}"

    def stop(self) -> tuple[bool, str]:
        """Close the bag, beside the loop."""
        if self._child is None:
            return False, "nothing is being recorded"
        if self._ending is None:
            self._ending = threading.Thread(target=self._child.stop, daemon=True)
            self._ending.start()
        return True, f"closing {self.name}"

    def look(self) -> str:
        """A line when the recorder has ended since the last call; else nothing."""
        child = self._child
        if child is None or child.running:
            return ""
        exit_ = child.ended()
        name, last = self.name, child.last_lines(1)
        self._child, self._ending, self.name = None, None, ""
        if exit_ is not None and exit_.status != 0:
            return f"{exit_}: {last[0] if last else 'it said nothing'}"
        return f"recorded {name}"

    def close(self) -> None:
        """Close the bag and wait for it."""
        if self._child is not None:
            self._child.stop()
