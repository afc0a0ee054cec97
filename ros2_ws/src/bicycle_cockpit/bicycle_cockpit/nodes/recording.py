"""A recorder that pages may start and end: the same process that record.sh runs."""

from __future__ import annotations

import threading
import time
from pathlib import Path

from bicycle_bringup.processes import Child, Vigil, registry_of
from bicycle_bringup.ride_options import program, workspace


class Recording:
    """At most one recorder at a time, into the folder of the bags.

    Attributes:
        failures: a line about each recorder that ended otherwise than with status 0.
    """

    def __init__(self, folder: Path, logs: Path) -> None:
        """Record into `folder`; what the recorder prints goes to a log in `logs`."""
        self.failures: list[str] = []
        self._folder, self._logs = folder, logs
        self._child: Child | None = None
        self._ending: threading.Thread | None = None
        self._words: list[str] = []
        self.name = ""
        """Of the bag being recorded; empty while none is."""

    @property
    def closing(self) -> bool:
        """Whether the recorder was asked to end and still writes."""
        return self._ending is not None

    def start(self) -> tuple[bool, str]:
        """Begin a new bag; whether it could, and a line about it."""
        if self.closing:
            return False, f"{self.name} is still being written"
        if self._child is not None:
            return False, f"{self.name} is being recorded already"
        name = time.strftime("bag-%Y-%m-%d-%H%M%S")
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            bag, log = str(self._folder / name), self._logs / "recorder.log"
            command = [*program("recorder"), "--output", bag]
            child = Child("recorder", command, log, registry_of(workspace()), saves=bag)
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
            # Nobody at a terminal has said how long is too long.
            vigil = Vigil(self._words.append, lambda: 0)
            self._ending = threading.Thread(
                target=self._child.stop, args=(vigil,), daemon=True, name="closing"
            )
            self._ending.start()
        return True, f"closing {self.name}"

    def look(self) -> str:
        """A line when the recorder has ended since the last call, or keeps us waiting."""
        child = self._child
        if child is None:
            return ""
        if child.running:
            return self._words.pop(0).partition(";")[0] if self._words else ""
        exit_ = child.ended()
        name, last = self.name, child.last_lines(1)
        self._child, self._ending, self.name = None, None, ""
        self._words.clear()
        if exit_ is not None and exit_.status != 0:
            self.failures.append(f"{exit_}: {last[0] if last else 'it said nothing'}")
            return self.failures[-1]
        return f"recorded {name}"

    def close(self, vigil: Vigil) -> None:
        """Close the bag and wait for it."""
        child = self._child
        if child is None:
            return
        if child.stop(vigil) is None:
            self.failures.append(child.left())
        else:
            self.look()
