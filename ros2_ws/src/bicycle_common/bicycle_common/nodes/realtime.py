"""Real-time priority for the processes of the 40 Hz loop, so that no other process delays them."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from bicycle_common.parameters import parameter

HOW = "allow it with `ulimit -r` or rtprio in /etc/security/limits.conf"


def priority_parameter() -> int:
    """Return the dataclass field of the priority parameter of nodes in the loop."""
    return parameter(
        10, "SCHED_FIFO priority in real time, where the system permits it; 0 is none", 0, 99
    )


class Priority:
    """Scheduling priority of a process's threads."""

    def __init__(self, process: int | None = None) -> None:
        """Begin with the default scheduler.

        Args:
            process: id; None for this process.
        """
        self._now = 0
        self._threads = Path("/proc") / ("self" if process is None else str(process)) / "task"

    def take(self, priority: int) -> str:
        """Set the priority of all threads; threads started later inherit it.

        Args:
            priority: 1 to 99 for SCHED_FIFO, 0 for the default scheduler.

        Returns:
            A line for the user; empty if nothing changes.
        """
        if priority == self._now:
            return ""
        policy = os.SCHED_FIFO if priority else os.SCHED_OTHER
        self._now = priority
        try:
            for thread in self._threads.iterdir():
                with contextlib.suppress(ProcessLookupError):  # the thread has ended since
                    os.sched_setscheduler(int(thread.name), policy, os.sched_param(priority))
        except PermissionError:
            return (
                f"real-time priority {priority} is not permitted, other programs may delay the "
                f"loop: {HOW}"
            )
        except OSError as error:
            return f"no real-time priority ({error.strerror}): other programs may delay the loop"
        return f"real-time priority {priority}" if priority else "ordinary priority"
