"""Observation of a policy (the paper's six states), and the bearing of a goal."""

from __future__ import annotations

import math

import numpy as np

from bicycle_common.geometry import heading_error
from bicycle_common.types import BicycleState, Point2D


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


def goal_bearing(snapshot: BicycleState, goal: Point2D | None) -> tuple[float, float]:
    """Return a goal's heading error psi_g (rad) and distance (m) from a state; NaN without one."""
    if goal is None:
        return math.nan, math.nan
    x, y = snapshot.rear_x, snapshot.rear_y
    error = heading_error(snapshot.heading, x, y, *goal)
    return float(error), math.hypot(goal[0] - x, goal[1] - y)


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
