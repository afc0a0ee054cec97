"""Stream of live transitions: it counts missing steps and truncates the pursuit at each gap."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bicycle_common.observation import ACTION_FIELDS, OBSERVATION_FIELDS
from bicycle_common.types import Transition

COLUMNS = (len(OBSERVATION_FIELDS), len(ACTION_FIELDS), 1, len(OBSERVATION_FIELDS), 1, 1, 1)
"""Widths of a packed transition: observation, action, reward, next observation, terminated,
truncated, fallen."""


class TransitionStream:
    """Holds each transition back until the next one shows if it continues.

    Attributes:
        arrived: number of transitions taken in.
        lost: number of transitions that never arrived, by their step numbers.
        policy: id of the policy that chose the last action; empty before the first.
    """

    def __init__(self) -> None:
        """Start before the first transition."""
        self.arrived = self.lost = 0
        self.policy = ""
        self._held: Transition | None = None

    def take(self, made: Transition) -> list[Transition]:
        """Take in one transition; return those that are complete now, in order."""
        last, self._held = self._held, None
        self.arrived += 1
        self.policy = made.policy
        complete = []
        if last is not None:
            goes_on = (made.episode, made.goal_id) == (last.episode, last.goal_id)
            ahead = made.step - last.step - 1
            if made.episode == last.episode and ahead > 0:
                self.lost += ahead
            complete.append(last if goes_on and ahead == 0 else replace(last, truncated=True))
        if made.terminated or made.truncated or made.fallen:
            complete.append(made)
        else:
            self._held = made
        return complete


def packed(transitions: list[Transition]) -> np.ndarray:
    """Return transitions as one array (M, 19), for another process."""
    rows = [
        (
            *made.observation,
            *made.action,
            made.reward,
            *made.next_observation,
            made.terminated,
            made.truncated,
            made.fallen,
        )
        for made in transitions
    ]
    return np.array(rows, dtype=np.float64).reshape(len(rows), sum(COLUMNS))


def unpacked(rows: np.ndarray) -> list[np.ndarray]:
    """Return the columns of packed transitions: (M, 6), (M, 3), (M,), (M, 6), and 3 bool (M,)."""
    parts = np.split(rows, np.cumsum(COLUMNS)[:-1], axis=1)
    return [*parts[:2], parts[2][:, 0], parts[3], *(part[:, 0] > 0 for part in parts[4:])]
