"""Transitions as one array of numbers, for another process."""

from __future__ import annotations

import numpy as np

from bicycle_common.observation import ACTION_FIELDS, OBSERVATION_FIELDS
from bicycle_controller.data.transition_builder import Transitions

COLUMNS = (len(OBSERVATION_FIELDS), len(ACTION_FIELDS), 1, len(OBSERVATION_FIELDS), 1, 1, 1)
"""Widths of a packed transition: observation, action, reward, next observation, terminated,
truncated, fallen."""


def packed(found: Transitions) -> np.ndarray:
    """Return transitions as one array (M, 19)."""
    columns = (
        found.observation,
        found.action,
        found.reward[:, None],
        found.next_observation,
        *(flags[:, None] for flags in (found.terminated, found.truncated, found.fallen)),
    )
    return np.concatenate(columns, axis=1, dtype=np.float64)


def unpacked(rows: np.ndarray) -> list[np.ndarray]:
    """Return the columns of packed transitions: (M, 6), (M, 3), (M,), (M, 6), and 3 bool (M,)."""
    parts = np.split(rows, np.cumsum(COLUMNS)[:-1], axis=1)
    return [*parts[:2], parts[2][:, 0], parts[3], *(part[:, 0] > 0 for part in parts[4:])]
