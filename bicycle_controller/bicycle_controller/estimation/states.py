"""States that are estimated of N bicycles, in their order, and an estimate.

Signs are the paper's: lean, steering and yaw rate are positive to the left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

STATES = (
    "lean_angle",
    "lean_rate",
    "steer_angle",
    "steer_rate",
    "gust",
    "speed",
    "roll_gyro_bias",
    "yaw_gyro_bias",
    "side_force_bias",
    "steer_offset",
)
"""States, the rows of the covariance; rad, rad/s, rad, rad/s, rad, m/s, rad/s, rad/s, m/s^2, rad.

The gust is the lean whose weight would push the bicycle over as the wind does.
"""
LEAN, LEAN_RATE, STEER, STEER_RATE, GUST, SPEED, ROLL_BIAS, YAW_BIAS, FORCE_BIAS, OFFSET = range(
    10
)

COURSE = ("heading", "x", "y")
"""Rows of the second covariance; rad, m, m. In the filter's memory they follow STATES."""
HEADING, X, Y = range(len(STATES), len(STATES) + len(COURSE))


@dataclass(frozen=True)
class Estimate:
    """Motion of N bicycles at one time; arrays (N,) unless said otherwise."""

    time: float
    """s of the sensors' clock."""
    lean_angle: np.ndarray
    lean_rate: np.ndarray
    lean_acceleration: np.ndarray
    """rad/s^2, of the model."""
    steer_angle: np.ndarray
    steer_rate: np.ndarray
    heading: np.ndarray
    yaw_rate: np.ndarray
    speed: np.ndarray
    x: np.ndarray
    """m, rear contact; below too."""
    y: np.ndarray
    biases: np.ndarray
    """(N, 4), the last four of STATES."""
    covariance: np.ndarray
    """(N, 10, 10), of STATES."""
    course_covariance: np.ndarray
    """(N, 3, 3), of COURSE."""
    calibrated: np.ndarray
    """bool: True once the gyros' biases are known from a rest."""
