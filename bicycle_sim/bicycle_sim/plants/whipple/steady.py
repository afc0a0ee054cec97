"""Steady turns of the nonlinear Whipple bicycle: circles that it rides for ever."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bicycle_sim.plants.base import Array
from bicycle_sim.plants.whipple.constants import Constants
from bicycle_sim.plants.whipple.equations import Forces, motion
from bicycle_sim.plants.whipple.kinematics import Pose, Rolling, front_height, rolling


class Turn(NamedTuple):
    """Steady turns; every field is (N,)."""

    lean: np.ndarray
    """rad."""
    pitch: np.ndarray
    """rad."""
    steer_torque: np.ndarray
    """N m that hold the steering."""
    yaw_rate: np.ndarray
    """rad/s."""


def on_the_road(
    k: Constants, lean: Array, steer: Array, pitch: Array = 0.0
) -> tuple[Array, Rolling]:
    """Return the pitch, rad, at which both wheels touch the road, and that pose's `rolling`.

    Args:
        k: of the bicycles.
        lean: (N,) rad.
        steer: (N,) rad.
        pitch: (N,) rad from where Newton's method begins.
    """
    for _ in range(8):
        r = rolling(k, lean, pitch, steer)
        pitch = pitch - front_height(k, r) / r.pitch_lever
    return pitch, rolling(k, lean, pitch, steer)


def _imbalance(
    k: Constants, lean: Array, steer: Array, speed: Array, pitch: Array
) -> tuple[Array, Array, Array, Array]:
    """N m that are missing in lean, then the pitch, the steer torque and the yaw rate."""
    pitch, r = on_the_road(k, lean, steer, pitch)
    zero = 0.0 * lean
    m = motion(k, Pose(lean, pitch, steer, zero, zero, speed), Forces(), r)
    m11, m12, m13, m22, m23, m33 = m.mass
    lean_load = m11 * m.lean + m12 * m.steer + m13 * m.speed
    steer_load = m12 * m.lean + m22 * m.steer + m23 * m.speed
    rim = -(m13 * m.lean + m23 * m.steer + m33 * m.speed)
    # The rim force that keeps the speed (next to none) acts on the pitch, too.
    lean_load = lean_load + r.pitch[0] * rim * k.rear_radius
    return lean_load, pitch, -(steer_load + r.pitch[1] * rim * k.rear_radius), m.yaw_rate


def turn(k: Constants, steer: np.ndarray, speed: np.ndarray) -> Turn:
    """Return steady turns at steering angles (N,), rad, and speeds (N,), m/s, with rigid riders.

    NaN where there is none with a lean below 75 degrees.
    """
    steer, speed = np.broadcast_arrays(np.asarray(steer, float), np.asarray(speed, float))
    with np.errstate(all="ignore"):
        lean = _guess(k, steer, speed)
        pitch = np.zeros(steer.shape)
        for _ in range(30):
            step = 1e-6
            here, pitch, _, _ = _imbalance(k, lean, steer, speed, pitch)
            there = _imbalance(k, lean + step, steer, speed, pitch)[0]
            change = np.clip(here / ((there - here) / step), -0.2, 0.2)
            change = np.where(np.isfinite(change), change, 0.0)
            lean = lean - change
            if np.abs(change).max(initial=0.0) < 1e-15:
                break
        missing, pitch, torque, yaw = _imbalance(k, lean, steer, speed, pitch)
    weight = k.gravity * (k.rear_mass + k.front_mass)
    good = (np.abs(missing) < 1e-6 * weight) & (np.abs(lean) < 1.3)
    return Turn(*(np.where(good, value, np.nan) for value in (lean, pitch, torque, yaw)))


def lean(k: Constants, steer: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Return the lean (N,), rad, in steady turns; if there is none, the nearest guess."""
    found = turn(k, steer, speed).lean
    guess = _guess(k, np.asarray(steer, float), np.asarray(speed, float))
    return np.where(np.isfinite(found), found, guess)


TABLE_SPEEDS = np.linspace(0.5, 12.0, 93)
"""m/s; beyond them the nearest one holds."""
TABLE_STEERS = 71
"""Steering angles from zero to the limit."""


class TurnTable:
    """Lean and torque of steady turns of bicycles that are alike, over steering and speed."""

    def __init__(self, k: Constants, steer_limit: float) -> None:
        """Compute the table.

        Args:
            k: of the bicycles.
            steer_limit: rad; beyond it the turn at it holds.
        """
        self._steer_step = steer_limit / (TABLE_STEERS - 1)
        steers, speeds = np.meshgrid(np.linspace(0.0, steer_limit, TABLE_STEERS), TABLE_SPEEDS)
        found = turn(k, steers.ravel(), speeds.ravel())
        guess = _guess(k, steers.ravel(), speeds.ravel())
        self._leans = np.where(np.isfinite(found.lean), found.lean, guess).reshape(steers.shape)
        self._torques = _filled(found.steer_torque.reshape(steers.shape))

    def lean(self, steer: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return (N,) rad at steering (N,), rad, and speed (N,), m/s."""
        return self._interpolated(self._leans, steer, speed)

    def torque(self, steer: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return (N,) N m that hold the turn; where there is none, that of the tightest."""
        return self._interpolated(self._torques, steer, speed)

    def _interpolated(self, table: np.ndarray, steer: np.ndarray, speed: np.ndarray) -> np.ndarray:
        spacing = TABLE_SPEEDS[1] - TABLE_SPEEDS[0]
        row, up = _place((speed - TABLE_SPEEDS[0]) / spacing, len(TABLE_SPEEDS))
        column, along = _place(np.abs(steer) / self._steer_step, TABLE_STEERS)
        low = table[row, column] * (1.0 - along) + table[row, column + 1] * along
        row = row + 1
        high = table[row, column] * (1.0 - along) + table[row, column + 1] * along
        return np.sign(steer) * (low * (1.0 - up) + high * up)


def _filled(table: np.ndarray) -> np.ndarray:
    """Return the table with every NaN replaced by the last number before it in its row."""
    last = np.where(np.isfinite(table), np.arange(table.shape[1]), 0)
    filled = np.take_along_axis(table, np.maximum.accumulate(last, axis=1), axis=1)
    return np.nan_to_num(filled)


def _place(at: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the row of a table below `at`, in rows, and the share of the next one."""
    inside = np.clip(np.nan_to_num(at), 0.0, size - 1.0)
    row = np.minimum(inside.astype(np.intp), size - 2)
    return row, inside - row


def _guess(k: Constants, steer: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Return a mass point's lean (N,), rad, on the circle of this steering."""
    curvature = np.tan(steer) * np.cos(k.tilt) / (k.turn_limit / 0.05)
    angle: np.ndarray = -np.arctan(speed * speed * curvature / k.gravity)
    return np.clip(-angle, -1.2, 1.2)
