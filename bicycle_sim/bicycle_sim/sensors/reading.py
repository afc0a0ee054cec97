"""Readings of sensors, of N bicycles at once, and how they are written as numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ORDER = ("imu", "steer", "wheel", "gnss")
"""Sensors, in the order in which readings of the same time are taken."""

FIELDS = {
    "imu": ("gyro_x", "gyro_y", "gyro_z", "force_x", "force_y", "force_z"),
    "steer": ("angle", "torque"),
    "wheel": ("speed",),
    "gnss": ("x", "y", "velocity_x", "velocity_y"),
}
"""Fields of a reading. IMU: rad/s and m/s^2 in the sensor's axes (REP-103, at rest and level
force_z is g). Steer: rad and N m, positive to the left. Wheel: m/s. GNSS: m and m/s on the map."""


@dataclass(frozen=True)
class Reading:
    """One measurement of one sensor on each of N bicycles."""

    sensor: str
    """Sensor's name, one of ORDER."""
    stamp: float
    """s of the sensors' clock."""
    arrival: np.ndarray
    """(N,) s of the same clock."""
    lost: np.ndarray
    """(N,) bool: True where it never arrives."""
    values: np.ndarray
    """(N, k), see FIELDS."""
