"""The learning process as the trainer node sees it: started, fed, listened to and ended.

Learning runs in a process of its own, so that neither its arithmetic nor its lock on the
interpreter can hold up a callback; torch is imported there only.
"""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import os
import signal
from typing import Any

import numpy as np

from bicycle_controller.trainer_service.order import TrainingOrder

NICE = 10
"""Added to the learning process's niceness: the loop and the controller come first."""
PATIENCE = 60.0
"""s for the learning process to save and end."""

SET_PARENT_DEATH_SIGNAL = 1
"""PR_SET_PDEATHSIG of Linux' prctl(2)."""


class TrainerClient:
    """One learning process."""

    def __init__(self, order: TrainingOrder) -> None:
        """Start it."""
        context = multiprocessing.get_context("spawn")
        self._inbox = context.Queue()
        self._outbox, child = context.Pipe(duplex=False)
        self._process = context.Process(
            target=_work, args=(order, self._inbox, child), name="learner", daemon=True
        )
        self._process.start()
        child.close()

    @property
    def alive(self) -> bool:
        """Whether it still runs."""
        return self._process.is_alive()

    def feed(self, rows: np.ndarray) -> None:
        """Hand over packed transitions; never waits."""
        self._inbox.put(("rows", rows))

    def beat(self, name: str) -> None:
        """Name the policy that candidates must beat: a file, a shipped policy, or lqr."""
        self._inbox.put(("beat", name))

    def in_charge(self, policy_id: str) -> None:
        """Tell that an offered policy has been loaded, and is the one to beat now."""
        self._inbox.put(("in charge", policy_id))

    def news(self) -> list[dict[str, Any]]:
        """What it has told since the last call."""
        found: list[dict[str, Any]] = []
        try:
            while self._outbox.poll():
                found.append(self._outbox.recv())
        except (EOFError, OSError):
            pass  # it has ended; `alive` tells
        return found

    def stop(self) -> bool:
        """End it; whether it saved and ended by itself."""
        self._inbox.cancel_join_thread()
        self._inbox.close()
        if self._process.is_alive() and self._process.pid is not None:
            with contextlib.suppress(PermissionError):  # only a superuser may take niceness back
                os.setpriority(os.PRIO_PROCESS, self._process.pid, 0)
            self._process.terminate()
            self._process.join(PATIENCE)
        clean = not self._process.is_alive()
        if not clean:
            self._process.kill()
            self._process.join(PATIENCE)
        return clean


def _end_with_parent() -> None:
    """Have the kernel send SIGTERM when the node is gone, killed while torch loads, say."""
    parent = multiprocessing.parent_process()
    ctypes.CDLL(None).prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGTERM)
    if parent is not None and os.getppid() != parent.pid:
        os._exit(1)  # it went before the kernel was asked


def _work(order: TrainingOrder, inbox: Any, outbox: Any) -> None:
    """The learning process's beginning."""
    os.setsid()  # a terminal's Ctrl-C is for the node, which ends this process in its own time
    os.nice(NICE)
    _end_with_parent()
    from bicycle_controller.trainer_service.worker import work

    work(order, inbox, outbox)
    outbox.close()
    os._exit(0)  # all is on the disk; torch takes a second to leave by itself
