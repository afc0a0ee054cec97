"""Nodes of a ride as child processes: start with a log, watch, and stop."""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import os
import signal
import subprocess
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path

from bicycle_common import signals
from bicycle_common.validation import one_line

PATIENCE = 10.0
"""Time for a process to react to a signal (s): on a busy machine it is slow, not stuck."""
FIRST_WORD, NEXT_WORD = 2.0, 10.0
"""Wait before the first message about a process that is still saving, and between messages (s)."""
ASKED = (-signal.SIGINT, -signal.SIGTERM, 128 + signal.SIGINT, 128 + signal.SIGTERM)
"""Exit statuses of a clean end of a process with nothing to save, such as one starting up."""
TAIL = 64 * 1024
"""End of a log in which its last lines are looked for (bytes)."""
LONGEST = 1000
"""End of a long line that is shown (characters)."""
LOOK = 0.05
"""Polling period while waiting for a process (s)."""
BACK_OFF = 1.0
"""Delay between a process's death and its restart (s)."""
MOST_DEATHS = 5
"""Deaths of one process after which it is given up."""

_LIBC = ctypes.CDLL(None)
_PR_SET_PDEATHSIG = 1


@dataclass(frozen=True)
class Exit:
    """Unexpected end of one process."""

    name: str
    status: int
    """Exit status, negative for the signal that killed it."""

    def __str__(self) -> str:
        """Return a description for the user."""
        if self.status < 0:
            return f"{self.name} was killed by {signal.Signals(-self.status).name}"
        return f"{self.name} exited with status {self.status}"


class SaveWait:
    """Waits for a process that is saving, tells the user, and stops waiting on Ctrl-C.

    Args:
        say: prints a line.
        interrupts: returns the number of Ctrl-C so far; one after a line of `say` ends the wait.
    """

    def __init__(self, say: Callable[[str], object], interrupts: Callable[[], int]) -> None:
        self._say = say
        self._interrupts = interrupts
        self.begin("")

    def begin(self, what: str) -> None:
        """Begin to wait; `what` names the activity, in the present tense."""
        self._what = what
        self._told: int | None = None
        self._next = FIRST_WORD

    def goes_on(self, waited: float) -> bool:
        """Return True to continue the wait after `waited` seconds."""
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
    """One node in its own session, so that a terminal's Ctrl-C reaches only the ride.

    The kernel ends it if this process ends in any way. Its output goes to a log.

    Args:
        name: for messages and the log's file name.
        command: program and arguments.
        log: file to which its output is appended.
        registry: folder where stop.sh looks for running processes; None to leave no entry.
        saves: what it writes; such a process is waited for and never killed. Empty for nothing.
        early: True if it starts through `bicycle_common.signals`, which handles early signals.
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
        """Start or restart it."""
        with self.log.open("ab") as log:
            self._process = subprocess.Popen(
                self.command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=_begin_early if self._early else end_with_parent,
            )
        if self._registry is not None:
            self._registry.mkdir(parents=True, exist_ok=True)
            self._note = self._registry / f"{self.name}.{self._process.pid}"
            self._note.write_text(f"{_start_time(self._process.pid)}\n")

    @property
    def running(self) -> bool:
        """True if it was started and has not ended."""
        return self._process is not None and self._process.poll() is None

    def ended(self) -> Exit | None:
        """Return how it ended; None while it runs."""
        if self._process is None or self._process.poll() is None:
            return None
        self._forget()
        return Exit(self.name, self._process.returncode)

    def last_lines(self, count: int = 3) -> list[str]:
        """Return the last lines of its log, each as one line that ends, however it was written."""
        try:
            with self.log.open("rb") as log:
                log.seek(max(0, log.seek(0, os.SEEK_END) - TAIL))
                text = log.read(TAIL).decode(errors="replace")
        except OSError:
            return []
        lines = [one_line(line.strip()) for line in text.split("\n") if line.strip()]
        return [one if len(one) <= LONGEST else f"...{one[-LONGEST:]}" for one in lines[-count:]]

    def stop(self, save_wait: SaveWait | None = None, patience: float = PATIENCE) -> int | None:
        """Stop it: SIGINT, then SIGTERM, then SIGKILL, each after `patience` seconds.

        A process that saves gets no SIGKILL: it is waited for.

        Args:
            save_wait: reports the wait and may end it; None for a silent wait.
            patience: wait before each further signal, s.

        Returns:
            Its exit status; None if it never ran, or was left to end on its own.
        """
        if self._process is None:
            return None
        steps = [(0.0, signal.SIGINT), (patience, signal.SIGTERM), (2 * patience, signal.SIGKILL)]
        if self.saves:
            steps.pop()
        if save_wait is not None:
            why = "a slow disk or a busy machine"
            save_wait.begin(f"the {self.name} is still writing {self.saves} ({why})")
        began = time.monotonic()
        while self._process.poll() is None:
            waited = time.monotonic() - began
            if steps and waited >= steps[0][0]:
                self._process.send_signal(steps.pop(0)[1])
                # A process stopped by SIGSTOP would not react.
                self._process.send_signal(signal.SIGCONT)
            if self.saves and save_wait is not None and not save_wait.goes_on(waited):
                return None
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(LOOK)
        self._forget()
        return self._process.returncode

    def is_well(self, status: int) -> bool:
        """Return True for a good end: status 0, or asked to end before it had begun to save."""
        return status == 0 or (status in ASKED and not (self.saves and Path(self.saves).exists()))

    def left(self) -> str:
        """Return a line for a user who did not wait for it."""
        assert self._process is not None
        return (
            f"left the {self.name} (process {self._process.pid}), which goes on writing "
            f"{self.saves}: do not kill it; stop.sh waits for it"
        )

    def _forget(self) -> None:
        """Remove the entry for stop.sh."""
        if self._note is not None:
            self._note.unlink(missing_ok=True)


class ProcessGroup:
    """Processes of one ride.

    Args:
        commands: program and arguments of each, by name, in start order.
        folder: folder of their logs.
        registry: as for `ManagedProcess`.
        saves: what a process writes, by name; see `ManagedProcess`.
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
        """Start the named processes, or all."""
        for name in names or self._children:
            self._children[name].start()

    def ended(self) -> list[Exit]:
        """Return the ends of all that have ended."""
        exits = (child.ended() for child in self._children.values())
        return [exit_ for exit_ in exits if exit_ is not None]

    def log_tail(self, name: str) -> str:
        """Return the last line of one process's log, and the log's path."""
        child = self._children[name]
        lines = child.last_lines(1)
        return f"{lines[0] if lines else 'it said nothing'} (log: {child.log})"

    def stop(self, *order: str, save_wait: SaveWait | None = None) -> list[str]:
        """Stop the processes one after the other.

        Returns:
            A line for each that was left, or ended with another status than 0.
        """
        lines = []
        for name in order:
            child = self._children[name]
            if not child.running:
                continue
            status = child.stop(save_wait)
            if status is None:
                lines.append(child.left())
            elif not child.is_well(status):
                lines.append(f"{Exit(name, status)}: {self.log_tail(name)}")
        return lines

    @property
    def left(self) -> bool:
        """Return True if one of them still runs."""
        return any(child.running for child in self._children.values())


class Supervisor:
    """Restarts dead processes of a group, each at most `MOST_DEATHS` times.

    Args:
        group: of the processes; a process that the group stopped is not dead.
    """

    def __init__(self, group: ProcessGroup) -> None:
        self._group = group
        self._deaths: Counter[str] = Counter()
        self._due: dict[str, float] = {}

    def death(self) -> Exit | None:
        """Return a death for which no restart is due; None without one."""
        return next((one for one in self._group.ended() if one.name not in self._due), None)

    def retry(self, name: str) -> bool:
        """Schedule a restart after `BACK_OFF`; return False if the process is given up."""
        if self._deaths[name] >= MOST_DEATHS:
            return False
        self._deaths[name] += 1
        self._due[name] = time.monotonic() + BACK_OFF
        return True

    def restarted(self) -> str | None:
        """Start a process whose restart is due; return its name, or None without one."""
        now = time.monotonic()
        name = next((name for name, due in self._due.items() if now > due), None)
        if name is not None:
            del self._due[name]
            self._group.start(name)
        return name

    def forgive(self) -> None:
        """Count deaths anew, after progress."""
        self._deaths.clear()


def end_with_parent(number: signal.Signals = signal.SIGTERM) -> None:
    """Ask the kernel to send this process a signal when its parent ends, even by SIGKILL."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, number)


def end_with_spawner(number: signal.Signals = signal.SIGTERM) -> None:
    """Do as `end_with_parent`, in a process of `multiprocessing`.

    Nothing is left running if the parent ended before the kernel was asked.
    """
    parent = multiprocessing.parent_process()
    end_with_parent(number)
    if parent is not None and os.getppid() != parent.pid:
        os._exit(1)


def begin_spawned(number: signal.Signals = signal.SIGTERM) -> None:
    """Make a process of `multiprocessing` one that its spawner alone stops; call it first there.

    It leaves the terminal's session, whose Ctrl-C is for the spawner, and ends with the spawner.
    The spawner starts it in `signals.blocked`: until here the Ctrl-C would reach it.

    Args:
        number: signal that it gets when the spawner ends.
    """
    os.setsid()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_spawner(number)
    signals.unblock()


def joined_or_killed(process: BaseProcess, patience: float) -> bool:
    """Wait for a process of `multiprocessing` that was asked to end; kill it after `patience` s.

    Returns:
        True if it ended by itself.
    """
    process.join(max(0.0, patience))
    clean = not process.is_alive()
    if not clean:
        process.kill()
        process.join(max(patience, PATIENCE))
    return clean


def _begin_early() -> None:
    """Do as `end_with_parent`, for a program that unblocks signals once it can handle them."""
    signals.block()
    end_with_parent()


def _start_time(pid: int) -> str:
    """Return when a process started, in kernel ticks; stop.sh compares it."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].split()[19]


def registry_of(workspace: Path) -> Path:
    """Return the folder where stop.sh looks for this domain's processes."""
    return workspace / "runs" / "pids" / os.environ.get("ROS_DOMAIN_ID", "0")
