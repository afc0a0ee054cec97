"""Recorder that pages can start and stop: the process of record.sh."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

from bicycle_cockpit.trouble import Line
from bicycle_common.node_commands import program, workspace
from bicycle_common.nodes.topics import STATE
from bicycle_common.processes import ManagedProcess, SaveWait, registry_of

HEARD = f"{STATE.name}: first message"
"""Line that the recorder prints once it receives the bicycle's state."""


class RecorderProcess:
    """Recorder's process, at most one at a time, which writes into the folder of bags.

    Attributes:
        failures: a line about each recorder that ended with another status than 0.
    """

    def __init__(self, folder: Path, logs: Path) -> None:
        """Record into `folder`; the recorder's output goes to a log in `logs`."""
        self.failures: list[str] = []
        self._folder, self._logs = folder, logs
        self._child: ManagedProcess | None = None
        self._ending: threading.Thread | None = None
        self._words: list[str] = []
        self._name = ""
        self._hears = False
        self._read_from = 0

    @property
    def state(self) -> dict[str, Any] | None:
        """Return `name` of the bag and its `phase`, for the pages.

        The phase is `starting` until the first state of the bicycle is recorded, then
        `recording`, and `closing` once it is asked to end. None without a recorder.
        """
        if self._child is None:
            return None
        phase = "recording" if self._hears else "starting"
        return {"name": self._name, "phase": "closing" if self._ending else phase}

    def start(self) -> tuple[bool, str]:
        """Begin a new bag; return True if that worked, and a line about it."""
        if self._ending is not None:
            return False, f"{self._name} is still being written"
        if self._child is not None:
            return False, f"{self._name} is being recorded already"
        name = time.strftime("bag-%Y-%m-%d-%H%M%S")
        bag, log = str(self._folder / name), self._logs / "recorder.log"
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            command = [*program("recorder"), "--output", bag]
            child = ManagedProcess(
                "recorder", command, log, registry_of(workspace()), bag, early=True
            )
            self._read_from = log.stat().st_size if log.exists() else 0
            child.start()
        except OSError as error:
            return False, f"cannot record into {self._folder}: {error.strerror}"
        self._child, self._name, self._hears = child, name, False
        return True, f"the recorder of {name} starts"

    def stop(self) -> tuple[bool, str]:
        """Close the bag without blocking the loop."""
        if self._child is None:
            return False, "nothing is being recorded"
        if self._ending is None:
            # No user at a terminal decides how long is too long.
            save_wait = SaveWait(self._words.append, lambda: 0)
            self._ending = threading.Thread(
                target=self._child.stop, args=(save_wait,), daemon=True, name="closing"
            )
            self._ending.start()
        return True, f"closing {self._name}"

    def look(self) -> Line | None:
        """Return a line if the recorder starts to record, delays its end, or has ended."""
        child = self._child
        if child is None:
            return None
        if child.running:
            if self._words:
                return Line("warn", self._words.pop(0).partition(";")[0])
            return self._first_message(child)
        exit_ = child.ended()
        name, last = self._name, child.last_lines(1)
        self._child, self._ending, self._name = None, None, ""
        self._words.clear()
        if exit_ is not None and not child.is_well(exit_.status):
            self.failures.append(f"{exit_}: {last[0] if last else 'it said nothing'}")
            return Line("bad", self.failures[-1])
        begun = (self._folder / name).exists()
        return Line("info", f"recorded {name}" if begun else f"{name} was ended before it began")

    def _first_message(self, child: ManagedProcess) -> Line | None:
        """Return a line once the recorder has reported that it receives the bicycle's state."""
        if self._hears or self._ending is not None:
            return None
        try:
            with child.log.open("rb") as log:
                log.seek(self._read_from)
                self._hears = HEARD.encode() in log.read()
        except OSError:
            return None
        return Line("info", f"recording {self._name}") if self._hears else None

    def close(self, save_wait: SaveWait) -> None:
        """Close the bag and wait for it."""
        child = self._child
        if child is None:
            return
        if child.stop(save_wait) is None:
            self.failures.append(child.left())
        else:
            self.look()
