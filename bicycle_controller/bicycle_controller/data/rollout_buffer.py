"""Data of PPO: the last T steps of N bicycles, and the advantages of their actions."""

from __future__ import annotations

from typing import Any

import numpy as np

from bicycle_controller.data.replay_buffer import OBSERVATIONS


class RolloutBuffer:
    """T rounds of N transitions, in the order of `replay_buffer.Batch`'s fields.

    Attributes:
        rows: (T, N, width) float32.
        rounds: number of rounds stored, up to T.
    """

    def __init__(self, rounds: int, count: int, actions: int) -> None:
        """Create an empty buffer for `rounds` steps of `count` bicycles."""
        self.actions = actions
        self.rows = np.zeros((rounds, count, 2 * OBSERVATIONS + actions + 5), dtype=np.float32)
        self.rounds = 0

    @property
    def full(self) -> bool:
        """True if it holds all T rounds."""
        return self.rounds == len(self.rows)

    def add(self, rows: np.ndarray) -> None:
        """Store the transitions (N, width) of one step, in the bicycles' order.

        Raises:
            ValueError: if it is full, or on another shape.
        """
        if self.full or rows.shape != self.rows.shape[1:]:
            raise ValueError(
                f"the rollout takes {len(self.rows)} times an array of shape"
                f" {self.rows.shape[1:]}, not {rows.shape} after {self.rounds}"
            )
        self.rows[self.rounds] = rows
        self.rounds += 1

    def clear(self) -> None:
        """Remove everything, because the policy that collected it has changed."""
        self.rounds = 0

    def state_dict(self) -> dict[str, Any]:
        """Return the rounds stored."""
        return {"rows": self.rows[: self.rounds].copy()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`."""
        self.clear()
        for rows in state["rows"]:
            self.add(rows)


def advantages(
    reward: np.ndarray,
    value: np.ndarray,
    next_value: np.ndarray,
    discount: np.ndarray,
    ended: np.ndarray,
    gae_lambda: float,
) -> np.ndarray:
    """Return the generalised advantage estimates (Schulman et al. 2016, equation 16).

    A sum of temporal differences stops at the end of an episode, for whatever reason; the
    difference itself looks ahead unless `discount` is 0, so that a time-out bootstraps.

    Args:
        reward: (T, N) of each step.
        value: (T, N), V of the state before it.
        next_value: (T, N), V of the state after it, before any reset.
        discount: (T, N), gamma, or 0 if nothing follows (a goal, or an absorbing fall).
        ended: bool (T, N), True if the next row belongs to another episode.
        gae_lambda: 0 looks one step ahead, 1 to the end.

    Returns:
        (T, N); with `value` added, the targets of V.
    """
    difference = reward + discount * next_value - value
    found = np.zeros_like(difference)
    following = np.zeros_like(difference[0])
    for step in reversed(range(len(difference))):
        carried = np.where(ended[step], 0.0, discount[step] * gae_lambda * following)
        following = difference[step] + carried
        found[step] = following
    return found
