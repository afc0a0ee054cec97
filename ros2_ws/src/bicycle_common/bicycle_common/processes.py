"""The nodes of a ride as child processes: started with a log, watched, ended in good order."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from bicycle_common import signals

PATIENCE = 10.0
"""s that a process gets to follow a signal: on a busy machine it is slow, not stuck."""
FIRST_WORD, NEXT_WORD = 2.0, 10.0
"""s after which people are told that somebody is waited for, and between such lines."""
ASKED = (-signal.SIGINT, -signal.SIGTERM, 128 + signal.SIGINT, 128 + signal.SIGTERM)
"""Ends as good as any of a process that has nothing to save, such as one that is starting."""
LOOK = 0.05
"""s between two looks at a process that is waited for."""

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


class Vigil:
    """Waits for a process that is saving, tells people so, and leaves it where they want that.

    Args:
        say: takes a line.
        interrupts: how many Ctrl-C have come; one after a line of `say` ends the wait.
    """

    def __init__(self, say: Callable[[str], object], interrupts: Callable[[], int]) -> None:
        self._say = say
        self._interrupts = interrupts
        self.begin("")

    def begin(self, what: str) -> None:
        """Begin to wait for something, which `what` says in the present tense."""
        self._what = what
        self._told: int | None = None
        self._next = FIRST_WORD

    def goes_on(self, waited: float) -> bool:
        """Whether to wait on, after `waited` seconds."""
        if self._told is not None and self._interrupts() > self._told:
            return False
        if waited >= self._next:
            self._next = waited + NEXT_WORD
            self._told = self._interrupts()
            self._say(
                f"{self._what}, waiting ({waited:.0f} s so far); Ctrl-C leaves it to end alone"
            )
        return True


class ManagedProcess:
    """One node in a session of its own, so that a terminal's Ctrl-C reaches the ride alone.

    It is told to end when this process is gone, however that ended, and its output goes to a log.

    Args:
        name: for people and for the log's name.
        command: program and arguments.
        log: file that its output is added to.
        registry: folder where stop.sh looks for what runs; None leaves no note.
        saves: what it writes that must not be lost: then it is waited for, and never killed.
        early: whether it starts by `bicycle_common.signals`, so that no signal is too early.
    """

    def __init__(
        self,
        name: str,
        command: Sequence[str],
        log: Path,
        registry: Path | None = None,
        saves: str = "",
        early: bool = False,
    ) -> None:
        self.name = name
        self.command = list(command)
        self.log = log
        self.saves = saves
        self._early = early
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
                preexec_fn=_begin_early if self._early else _die_with_parent,
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

    def stop(self, vigil: Vigil | None = None, patience: float = PATIENCE) -> int | None:
        """End it: SIGINT, then SIGTERM, then SIGKILL, each after `patience` seconds.

        One that saves gets no SIGKILL: it is waited for.

        Args:
            vigil: tells of that and may end the wait; without it, nobody is told.
            patience: s.

        Returns:
            Its exit status; None if it never ran, or was left to end alone.
        """
        if self._process is None:
            return None
        steps = [(0.0, signal.SIGINT), (patience, signal.SIGTERM), (2 * patience, signal.SIGKILL)]
        if self.saves:
            steps.pop()
        if vigil is not None:
            vigil.begin(f"the {self.name} is still writing {self.saves} (the disk is slow)")
        began = time.monotonic()
        while self._process.poll() is None:
            waited = time.monotonic() - began
            if steps and waited >= steps[0][0]:
                self._process.send_signal(steps.pop(0)[1])
                # One that is stopped would not follow.
                self._process.send_signal(signal.SIGCONT)
            if self.saves and vigil is not None and not vigil.goes_on(waited):
                return None
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(LOOK)
        self._forget()
        return self._process.returncode

    def is_well(self, status: int) -> bool:
        """Whether that is how it should end: with 0, or asked to before it had begun to save."""
        return status == 0 or (status in ASKED and not (self.saves and Path(self.saves).exists()))

    def left(self) -> str:
        """A line for people who did not wait for it."""
        assert self._process is not None
        return (
            f"left the {self.name} (process {self._process.pid}), which goes on writing "
            f"{self.saves}: do not kill it; stop.sh waits for it"
        )

    def _forget(self) -> None:
        """Remove the note for stop.sh."""
        if self._note is not None:
            self._note.unlink(missing_ok=True)


class ProcessGroup:
    """The processes of one ride.

    Args:
        commands: program and arguments of each, by name, in the order to start them.
        folder: where their logs go.
        registry: as for `ManagedProcess`.
        saves: by name, what one writes; see `ManagedProcess`.
        early: as for `ManagedProcess`.
    """

    def __init__(
        self,
        commands: Mapping[str, Sequence[str]],
        folder: Path,
        registry: Path | None = None,
        saves: Mapping[str, str] | None = None,
        early: bool = False,
    ) -> None:
        self._children = {
            name: ManagedProcess(
                name, command, folder / f"{name}.log", registry, (saves or {}).get(name, ""), early
            )
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

    def log_tail(self, name: str) -> str:
        """The last line of one's log, and where the rest is."""
        child = self._children[name]
        lines = child.last_lines(1)
        return f"{lines[0] if lines else 'it said nothing'} (log: {child.log})"

    def stop(self, *order: str, vigil: Vigil | None = None) -> list[str]:
        """End these one after the other.

        Returns:
            A line about each that was left, or ended otherwise than with status 0.
        """
        lines = []
        for name in order:
            child = self._children[name]
            if not child.running:
                continue
            status = child.stop(vigil)
            if status is None:
                lines.append(child.left())
            elif not child.is_well(status):
                lines.append(f"{Exit(name, status)}: {self.log_tail(name)}")
        return lines

    @property
    def left(self) -> bool:
        """Whether one of them still runs."""
        return any(child.running for child in self._children.values())


def _die_with_parent() -> None:
    """Have the kernel send SIGTERM when the ride is gone, even by SIGKILL."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def _begin_early() -> None:
    """The same for a program that unblocks signals when it can answer them."""
    signals.block()
    _die_with_parent()


def _start_time(pid: int) -> str:
    """When a process began, in the kernel's ticks; stop.sh compares it."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].split()[19]


def registry_of(workspace: Path) -> Path:
    """The folder where stop.sh looks for this domain's processes."""
    return workspace / "runs" / "pids" / os.environ.get("ROS_DOMAIN_ID", "0")
