"""Actions that arrive late, by a number of steps that each episode has for itself."""

from __future__ import annotations

from typing import Any

import numpy as np


class LateActions:
    """The actions of N bicycles under way.

    Attributes:
        delays: (N,) steps by which each bicycle's actions are late.
    """

    def __init__(self, count: int, most: int, rng: np.random.Generator) -> None:
        """Draw the first delays.

        Args:
            count: N.
            most: largest delay, steps; without one nothing is drawn.
            rng: source of the delays.
        """
        self._most, self._rng = most, rng
        self._queue = np.zeros((most + 1, count, 3))
        self.delays = np.zeros(count, dtype=np.int64)
        self.reset(np.ones(count, dtype=bool))

    def reset(self, mask: np.ndarray, late: np.ndarray | None = None) -> None:
        """Begin the episodes of `mask` (N,): new delays, and nothing under way.

        Those outside `late` (N,) have no delay.
        """
        if self._most == 0 or not mask.any():
            return
        count = int(mask.sum())
        self.delays[mask] = self._rng.integers(0, self._most + 1, count)
        if late is not None:
            self.delays[mask] *= late[mask]
        self._queue[:, mask] = 0.0

    def arriving(self, action: np.ndarray) -> np.ndarray:
        """Send actions (N, 3); return those that arrive."""
        if self._most == 0:
            return action
        self._queue = np.concatenate([action[None], self._queue[:-1]])
        found: np.ndarray = self._queue[self.delays, np.arange(len(action))]
        return found

    def state_dict(self) -> dict[str, Any]:
        """Return the actions under way."""
        return {"queue": self._queue.copy(), "delays": self.delays.copy()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`."""
        self._queue, self.delays = state["queue"], state["delays"]
