"""The nodes of a ride as child processes: started with a log, watched, ended in good order."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

PATIENCE = 2.0
"""s that a process gets to follow a signal."""

_LIBC = ctypes.CDLL(None)
_PR_SET_PDEATHSIG = 1


@dataclass(frozen=True)
class Exit:
    """The unasked end of one process."""

    name: str
    status: int
    """Exit status, negative for the signal that killed it."""

    def __str__(self) -> str:
        """Say it as a person would."""
        if self.status < 0:
            return f"{self.name} was killed by {signal.Signals(-self.status).name}"
        return f"{self.name} exited with status {self.status}"


class Child:
    """One node in a session of its own, so that a terminal's Ctrl-C reaches the ride alone.

    It dies with this process, however that ends, and its output goes to a log.

    Args:
        name: for people and for the log's name.
        command: program and arguments.
        log: file that its output is added to.
        registry: folder where stop.sh looks for what runs; None leaves no note.
    """

    def __init__(
        self, name: str, command: Sequence[str], log: Path, registry: Path | None = None
    ) -> None:
        self.name = name
        self.command = list(command)
        self.log = log
        self._registry = registry
        self._note: Path | None = None
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start it, or start it again."""
        with self.log.open("ab") as log:
            self._process = subprocess.Popen(
                self.command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=_die_with_parent,
            )
        if self._registry is not None:
            self._registry.mkdir(parents=True, exist_ok=True)
            self._note = self._registry / f"{self.name}.{self._process.pid}"
            self._note.write_text(f"{_start_time(self._process.pid)}\n")

    @property
    def running(self) -> bool:
        """Whether it was started and has not ended."""
        return self._process is not None and self._process.poll() is None

    def ended(self) -> Exit | None:
        """How it ended; None while it runs."""
        if self._process is None or self._process.poll() is None:
            return None
        self._forget()
        return Exit(self.name, self._process.returncode)

    def last_lines(self, count: int = 3) -> list[str]:
        """The end of its log."""
        try:
            lines = self.log.read_text(errors="replace").splitlines()
        except OSError:
            return []
        return [line for line in lines if line.strip()][-count:]

    def stop(self, patience: float = PATIENCE) -> int | None:
        """End it: SIGINT, then SIGTERM, then SIGKILL, each after `patience` seconds.

        Returns:
            Its exit status; None if it never ran.
        """
        if self._process is None:
            return None
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            if self._process.poll() is not None:
                break
            self._process.send_signal(number)
            try:
                self._process.wait(patience)
            except subprocess.TimeoutExpired:
                continue
        self._forget()
        return self._process.wait()

    def _forget(self) -> None:
        """Remove the note for stop.sh."""
        if self._note is not None:
            self._note.unlink(missing_ok=True)


class Crew:
    """The processes of one ride.

    Args:
        commands: program and arguments of each, by name, in the order to start them.
        folder: where their logs go.
        registry: as for `Child`.
    """

    def __init__(
        self, commands: Mapping[str, Sequence[str]], folder: Path, registry: Path | None = None
    ) -> None:
        self._children = {
            name: Child(name, command, folder / f"{name}.log", registry)
            for name, command in commands.items()
        }

    def start(self, *names: str) -> None:
        """Start these, or all."""
        for name in names or self._children:
            self._children[name].start()

    def ended(self) -> list[Exit]:
        """Those that have ended."""
        exits = (child.ended() for child in self._children.values())
        return [exit_ for exit_ in exits if exit_ is not None]

    def last_words(self, name: str) -> str:
        """The last line of one's log, and where the rest is."""
        child = self._children[name]
        lines = child.last_lines(1)
        return f"{lines[0] if lines else 'it said nothing'} (log: {child.log})"

    def stop(self, *order: str) -> None:
        """End these one after the other."""
        for name in order:
            self._children[name].stop()


def _die_with_parent() -> None:
    """Have the kernel send SIGTERM when the ride is gone, even by SIGKILL."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def _start_time(pid: int) -> str:
    """When a process began, in the kernel's ticks; stop.sh compares it."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].split()[19]


def registry_of(workspace: Path) -> Path:
    """The folder where stop.sh looks for this domain's processes."""
    return workspace / "runs" / "pids" / os.environ.get("ROS_DOMAIN_ID", "0")
