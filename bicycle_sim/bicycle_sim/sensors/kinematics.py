"""Motion of a point on the rear frame, as an IMU there measures it.

Axes are REP-103: x forward, y left, z up. `level` axes are turned with the heading alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from bicycle_sim.plants.base import BodyState, Plant


@dataclass(frozen=True)
class Motion:
    """Inputs of the sensors' models, each (N,); the paper's signs, positive to the left."""

    lean: np.ndarray
    lean_rate: np.ndarray
    pitch: np.ndarray
    """rad, nose up."""
    steer: np.ndarray
    steer_torque: np.ndarray
    """N m that the motor gives."""
    heading: np.ndarray
    yaw_rate: np.ndarray
    speed: np.ndarray
    x: np.ndarray
    """m, rear contact; below too."""
    y: np.ndarray


def motion(plant: Plant[Any], state: BodyState, torque: np.ndarray) -> Motion:
    """Return the motion of N bicycles.

    Args:
        plant: they are of.
        state: the plant's state.
        torque: (N,) N m commanded, for a plant whose state says nothing of its motor.
    """
    zero = np.zeros_like(state.speed)
    return Motion(
        lean=state.lean_angle,
        lean_rate=state.lean_rate,
        pitch=getattr(state, "pitch", zero),
        steer=state.steer_angle,
        steer_torque=getattr(state, "motor_torque", torque),
        heading=state.heading,
        yaw_rate=plant.yaw_rate(state),
        speed=state.speed,
        x=state.rear_x,
        y=state.rear_y,
    )


def blend(first: Motion, second: Motion, share: float) -> Motion:
    """Return the motion at `share` of the way from the first to the second."""
    if share >= 1.0:
        return second
    values = {
        name: (1.0 - share) * value + share * getattr(second, name)
        for name, value in vars(first).items()
        if name != "heading"
    }
    turned = np.remainder(second.heading - first.heading + np.pi, 2.0 * np.pi) - np.pi
    return Motion(heading=first.heading + share * turned, **values)


def standing(m: Motion) -> Motion:
    """Return the same bicycle at rest, held upright with straight handlebars."""
    zero = np.zeros_like(m.lean)
    return Motion(
        lean=zero,
        lean_rate=zero,
        pitch=zero,
        steer=zero,
        steer_torque=zero,
        heading=m.heading,
        yaw_rate=zero,
        speed=zero,
        x=m.x,
        y=m.y,
    )


def frame_axes(m: Motion) -> np.ndarray:
    """Return the rear frame's axes (N, 3, 3) as columns in level axes."""
    sine, cosine = np.sin(-m.lean), np.cos(m.lean)
    up, level = np.sin(m.pitch), np.cos(m.pitch)
    zero = np.zeros_like(sine)
    # Roll about x (positive to the right), then pitch about y with the nose up.
    rows = (
        (level, zero, -up),
        (-sine * up, cosine, -sine * level),
        (cosine * up, sine, cosine * level),
    )
    return np.stack([np.stack(row, -1) for row in rows], -2)


def turning(m: Motion, pitch_rate: np.ndarray) -> np.ndarray:
    """Return the rear frame's angular velocity (N, 3), rad/s, in its own axes."""
    zero = np.zeros_like(m.lean)
    level = np.stack([-m.lean_rate, zero, m.yaw_rate], -1)
    found = np.einsum("nji,nj->ni", frame_axes(m), level)
    found[:, 1] -= pitch_rate
    return found


def point_velocity(
    m: Motion, axes: np.ndarray, turn: np.ndarray, point: np.ndarray, radius: float
) -> np.ndarray:
    """Return the velocity (N, 3), m/s, of a point, in level axes.

    Args:
        m: the motion.
        axes: of `frame_axes`.
        turn: of `turning`.
        point: (3,) m from the rear contact of the upright bicycle.
        radius: m, of the rear wheel.
    """
    sine, cosine = np.sin(-m.lean), np.cos(m.lean)
    centre = np.stack(
        [
            m.speed + radius * sine * m.yaw_rate,
            radius * cosine * m.lean_rate,
            radius * sine * m.lean_rate,
        ],
        -1,
    )
    arm = point - np.array([0.0, 0.0, radius])
    return centre + np.einsum("nij,nj->ni", axes, np.cross(turn, arm))


def point_place(m: Motion, point: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return x and y (N,), m, of a point of the rear frame on the map."""
    axes = frame_axes(m)
    centre = np.stack([0.0 * m.lean, radius * np.sin(m.lean), radius * np.cos(m.lean)], -1)
    level = centre + axes @ (point - np.array([0.0, 0.0, radius]))
    sine, cosine = np.sin(m.heading), np.cos(m.heading)
    # The heading is counter-clockwise from +y; forward is (-sine, cosine), left (-cosine, -sine).
    return (
        m.x - sine * level[:, 0] - cosine * level[:, 1],
        m.y + cosine * level[:, 0] - sine * level[:, 1],
    )
