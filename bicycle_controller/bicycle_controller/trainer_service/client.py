"""Client of the learning process, for the trainer node: start, feed, poll and stop.

Learning runs in its own process, so that neither its computation nor its interpreter lock can
block a callback; only that process imports torch.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
from typing import Any

import numpy as np

from bicycle_common.processes import begin_spawned, joined_or_killed
from bicycle_common.signals import blocked
from bicycle_controller.trainer_service.order import TrainingOrder

NICE = 10
"""Added to the learning process's niceness: the loop and the controller come first."""
PATIENCE = 60.0
"""Time for the learning process to save and end (s)."""


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
        with blocked():  # until `begin_spawned`
            self._process.start()
        child.close()

    @property
    def alive(self) -> bool:
        """True if it still runs."""
        return self._process.is_alive()

    def feed(self, rows: np.ndarray) -> None:
        """Send packed transitions; never blocks."""
        self._inbox.put(("rows", rows))

    def set_baseline(self, name: str) -> None:
        """Set the policy that candidates must beat: a file, a shipped policy, or lqr."""
        self._inbox.put(("baseline", name))

    def in_charge(self, policy_id: str) -> None:
        """Report that an offered policy has been loaded and is the new baseline."""
        self._inbox.put(("in charge", policy_id))

    def poll(self) -> list[dict[str, Any]]:
        """Return its reports since the last call."""
        found: list[dict[str, Any]] = []
        try:
            while self._outbox.poll():
                found.append(self._outbox.recv())
        except (EOFError, OSError):
            pass  # it has ended; see `alive`
        return found

    def stop(self) -> bool:
        """Stop it; return True if it saved and ended by itself."""
        self._inbox.cancel_join_thread()
        self._inbox.close()
        if self._process.is_alive() and self._process.pid is not None:
            with contextlib.suppress(PermissionError):  # only a superuser may lower niceness
                os.setpriority(os.PRIO_PROCESS, self._process.pid, 0)
            self._process.terminate()
        return joined_or_killed(self._process, PATIENCE)


def _work(order: TrainingOrder, inbox: Any, outbox: Any) -> None:
    """Run the learning process."""
    begin_spawned()
    os.nice(NICE)
    from bicycle_controller.trainer_service.worker import work

    work(order, inbox, outbox)
    outbox.close()
    os._exit(0)  # everything is saved; torch takes a second to shut down by itself
