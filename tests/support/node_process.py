"""Start one program of the stack, watch what it prints, and never leave it behind."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from waiting import PATIENCE


def parameters(**values: object) -> list[str]:
    """Return the arguments that give a node these parameters."""
    words = ["--ros-args"]
    for name, value in values.items():
        words += ["-p", f"{name}:={str(value).lower() if isinstance(value, bool) else value}"]
    return words


class NodeProcess:
    """One child process in its own process group, its output read line by line.

    Standard output and standard error are merged in the order they arrive. Use it as a context
    manager, or through the `start_node` fixture, so that a failed test kills the child.

    Args:
        command: Program and arguments.
        env: Variables on top of the test's own environment; an empty string unsets one.
        cwd: Working directory of the child.
    """

    def __init__(
        self, command: Sequence[str], env: Mapping[str, str] | None = None, cwd: Path | None = None
    ) -> None:
        self.command = [str(part) for part in command]
        self._lines: list[str] = []
        self._changed = threading.Condition()
        self._ended = False
        merged = {**os.environ, "PYTHONUNBUFFERED": "1", **(env or {})}
        self._child = subprocess.Popen(
            self.command,
            env={key: value for key, value in merged.items() if value != ""},
            cwd=cwd,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @classmethod
    def start(
        cls, module: str, args: Sequence[str] = (), env: Mapping[str, str] | None = None
    ) -> NodeProcess:
        """Run `python -m module args` with the interpreter of the test."""
        return cls([sys.executable, "-m", module, *args], env)

    def _read(self) -> None:
        assert self._child.stdout is not None
        for line in self._child.stdout:
            with self._changed:
                self._lines.append(line.rstrip("\n"))
                self._changed.notify_all()
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    @property
    def pid(self) -> int:
        """Process id, which is also the id of the child's process group."""
        return self._child.pid

    @property
    def running(self) -> bool:
        """True if the child has not ended yet."""
        return self._child.poll() is None

    @property
    def lines(self) -> list[str]:
        """Lines printed so far."""
        with self._changed:
            return list(self._lines)

    @property
    def output(self) -> str:
        """Everything printed so far."""
        return "\n".join(self.lines)

    def wait_for_line(self, pattern: str, timeout: float = PATIENCE) -> re.Match[str]:
        """Wait until a line matches `pattern` (searched, from the first line printed).

        Returns:
            The match.

        Raises:
            AssertionError: No such line within `timeout` seconds or before the output ended; the
                message holds what was printed.
        """
        regex = re.compile(pattern)
        deadline = time.monotonic() + timeout
        seen = 0
        with self._changed:
            while True:
                for line in self._lines[seen:]:
                    if match := regex.search(line):
                        return match
                seen = len(self._lines)
                left = deadline - time.monotonic()
                if self._ended or left <= 0.0:
                    why = "output ended" if self._ended else f"{timeout} s passed"
                    printed = "\n".join(self._lines)
                    raise AssertionError(
                        f"{why} without /{pattern}/ from {self.command}:\n{printed}"
                    )
                self._changed.wait(left)

    def send_signal(self, number: signal.Signals) -> None:
        """Send a signal to the child alone."""
        self._child.send_signal(number)

    def wait(self, timeout: float = PATIENCE) -> int:
        """Wait for the child's end.

        Returns:
            Its exit status, negative for a signal.

        Raises:
            AssertionError: It still runs after `timeout` seconds.
        """
        try:
            status = self._child.wait(timeout)
        except subprocess.TimeoutExpired:
            raise AssertionError(
                f"still running after {timeout} s: {self.command}\n{self.output}"
            ) from None
        self._reader.join(timeout)
        return status

    def stop(self, number: signal.Signals = signal.SIGINT, timeout: float = PATIENCE) -> int:
        """Send a signal, SIGINT by default, and wait for the end; returns the exit status."""
        self.send_signal(number)
        return self.wait(timeout)

    def kill(self) -> None:
        """End the child and everything it started, at once."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        self._child.wait()
        self._reader.join(5.0)

    def __enter__(self) -> NodeProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()


def children_of(pid: int) -> list[int]:
    """Processes that a process has started."""
    path = Path(f"/proc/{pid}/task/{pid}/children")
    return [int(word) for word in path.read_text().split()] if path.exists() else []


def alive(pid: int) -> bool:
    """Return True if a process runs; a zombie does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False
