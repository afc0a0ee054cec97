"""Waiting in tests: for events, and on a busy machine as long as it takes."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable
from typing import TypeVar

PATIENCE = 180.0
"""s after which a wait is taken for a hang; long, for what is waited for ends it before."""

Found = TypeVar("Found")


def until(
    condition: Callable[[], Found],
    process: subprocess.Popen[str] | subprocess.Popen[bytes] | None = None,
    patience: float = PATIENCE,
) -> Found:
    """Wait until a condition holds; returns what it gave.

    Args:
        condition: asked again and again.
        process: that makes it hold, if it is one; its end ends the wait.
        patience: s.

    Raises:
        AssertionError: it does not hold, though the process has ended or the time has passed.
    """
    deadline = time.monotonic() + patience
    while True:
        # In this order: what an ending process does last still counts.
        ended = process is not None and process.poll() is not None
        late = time.monotonic() > deadline
        value = condition()
        if value:
            return value
        assert not ended, f"the process ended before; {rest_of(process)}"
        assert not late, f"waited {patience:g} s in vain; {rest_of(process)}"
        time.sleep(0.02)


def finish(process: subprocess.Popen[str], patience: float = PATIENCE) -> tuple[str, str]:
    """Wait for a process to end and return its output.

    Raises:
        AssertionError: it has not ended; then it is killed first, and what it printed is told.
    """
    try:
        return process.communicate(timeout=patience)
    except subprocess.TimeoutExpired:
        raise AssertionError(f"still running after {patience:g} s; {rest_of(process)}") from None


def rest_of(process: subprocess.Popen[str] | subprocess.Popen[bytes] | None) -> str:
    """Kill a process, since reading a running one may hang, and return its output."""
    if process is None:
        return "no process"
    process.kill()
    printed = process.communicate()
    return f"status {process.returncode}, printed {printed}"
