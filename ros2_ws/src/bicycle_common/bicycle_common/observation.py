"""Observation of a policy: the paper's six states."""

from __future__ import annotations

import numpy as np

from bicycle_common.types import BicycleState


def observation(snapshot: BicycleState, heading_error: float) -> np.ndarray:
    """Return the paper's six states, shape (6,), with a heading error psi_g in rad."""
    return np.array(
        [
            snapshot.steer_angle,
            snapshot.steer_rate,
            snapshot.lean_angle,
            snapshot.lean_rate,
            snapshot.lean_acceleration,
            heading_error,
        ]
    )


OBSERVATION_FIELDS = (
    "steer_angle",
    "steer_rate",
    "lean_angle",
    "lean_rate",
    "lean_acceleration",
    "heading_error",
)
"""The six states in the authors' order (errata row 34): rad, rad/s, rad, rad/s, rad/s^2, rad."""


ACTION_FIELDS = ("torque", "displacement", "pedal_force")
"""The three actions in the authors' order: N m, m, N."""
