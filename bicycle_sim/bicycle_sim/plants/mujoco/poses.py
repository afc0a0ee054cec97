"""Conversion of lean, steering and speed to MuJoCo's coordinates and back.

MuJoCo's frame is the rear frame, at the rear wheel's centre, turned by yaw, roll and pitch about
its own z, x and y (forward, left, up). Roll is positive to the right, pitch with the nose down.
"""

from __future__ import annotations

import numpy as np

from bicycle_common.geometry import wrap_angle
from bicycle_sim.plants.whipple.constants import Constants
from bicycle_sim.plants.whipple.parameters import Bicycle
from bicycle_sim.plants.whipple.steady import on_the_road

Z = np.array([0.0, 0.0, 1.0])
QUARTER = 0.5 * np.pi
"""rad from the paper's heading, counter-clockwise from +y, to yaw, from +x."""
POSITIONS, SPEEDS = 10, 9
"""Numbers per bicycle: place, quaternion and three angles; two velocities and three rates."""


def about(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return rotation matrices (N, 3, 3) about a unit vector (3,) by angles (N,), rad."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    turned: np.ndarray = np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross)
    return turned


def _axes(b: Bicycle) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the steering axis and the way over it to the front wheel, straight; (3,) each.

    The way is from the rear wheel's centre to a point on the axis, and from there to the front
    wheel's centre, in the rear frame's axes.
    """
    axis = np.array([-np.sin(b.lam), 0.0, np.cos(b.lam)])
    return axis, np.array([b.w + b.c, 0.0, -b.rR]), np.array([-b.c, 0.0, b.rF])


def to_mujoco(b: Bicycle, k: Constants, body: dict[str, np.ndarray]) -> np.ndarray:
    """Return positions and speeds (N, 19) of rolling bicycles.

    Args:
        b: the bicycle.
        k: its constants.
        body: the fields of BodyState, (N,) each.
    """
    lean, steer = body["lean_angle"], body["steer_angle"]
    lean_rate, steer_rate, speed = body["lean_rate"], body["steer_rate"], body["speed"]
    pitch, r = on_the_road(k, lean, steer)
    yaw_rate = r.yaw[0] * lean_rate + r.yaw[1] * steer_rate + r.yaw[2] * speed
    pitch_rate = r.pitch[0] * lean_rate + r.pitch[1] * steer_rate
    yaw, roll = body["heading"] + QUARTER, -lean
    flat = about(Z, yaw)
    frame = (
        flat @ about(np.array([1.0, 0.0, 0.0]), roll) @ about(np.array([0.0, 1.0, 0.0]), -pitch)
    )

    zero = np.zeros_like(lean)
    down = np.stack([zero, np.sin(roll), -np.cos(roll)], axis=-1)
    changed = np.stack(
        [-yaw_rate * np.sin(roll), -lean_rate * np.cos(roll), -lean_rate * np.sin(roll)], axis=-1
    )
    place = np.stack([body["rear_x"], body["rear_y"], zero], axis=-1) - b.rR * _turn(flat, down)
    velocity = _turn(flat, np.stack([speed, zero, zero], axis=-1) - b.rR * changed)
    level = np.stack(
        [-lean_rate, -pitch_rate * np.cos(roll), yaw_rate - pitch_rate * np.sin(roll)], axis=-1
    )
    spin = _turn(flat, level)  # of the frame, in the world

    axis, to_axis, to_wheel = _axes(b)
    turned = frame @ about(axis, steer)
    pivot = frame @ axis
    wheel = turned @ to_wheel
    front_velocity = (
        velocity
        + np.cross(spin, frame @ to_axis + wheel)
        + steer_rate[:, None] * np.cross(pivot, wheel)
    )
    across = turned[:, :, 1]
    ahead = np.cross(across, Z)
    ahead /= np.linalg.norm(ahead, axis=-1, keepdims=True)
    front_spin = spin + steer_rate[:, None] * pivot
    front_rate = (front_velocity * ahead).sum(-1) / b.rF - (front_spin * across).sum(-1)
    rear_rate = speed / b.rR + pitch_rate
    own = np.einsum("nji,nj->ni", frame, spin)
    return np.column_stack(
        [
            place,
            _quaternion(frame),
            zero,
            steer,
            zero,
            velocity,
            own,
            rear_rate,
            steer_rate,
            front_rate,
        ]
    )


def from_mujoco(b: Bicycle, state: np.ndarray) -> dict[str, np.ndarray]:
    """Return the positions and speeds of BodyState (N, 19), and pitch and yaw rate."""
    place, quaternion, angles = state[:, 0:3], state[:, 3:7], state[:, 7:10]
    velocity, own, rates = state[:, 10:13], state[:, 13:16], state[:, 16:19]
    frame = _matrix(quaternion)
    across = frame[:, :, 1]
    roll = np.arcsin(np.clip(across[:, 2], -1.0, 1.0))
    yaw = np.arctan2(-across[:, 0], across[:, 1])
    flat = about(Z, yaw)
    spin = np.einsum("nji,nj->ni", flat, np.einsum("nij,nj->ni", frame, own))
    pitch_rate = spin[:, 1] / np.cos(roll)
    yaw_rate = spin[:, 2] - pitch_rate * np.sin(roll)
    along = np.einsum("nji,nj->ni", flat, velocity)[:, 0]
    rear = place + b.rR * _down(across)
    axis, to_axis, to_wheel = _axes(b)
    turned = frame @ about(axis, angles[:, 1])
    centre = place + frame @ to_axis + turned @ to_wheel
    front = centre + b.rF * _down(turned[:, :, 1])
    return {
        "lean_angle": -roll,
        "lean_rate": -spin[:, 0],
        "steer_angle": angles[:, 1].copy(),
        "steer_rate": rates[:, 1].copy(),
        "heading": np.asarray(wrap_angle(yaw - QUARTER)),
        "front_x": front[:, 0],
        "front_y": front[:, 1],
        "rear_x": rear[:, 0],
        "rear_y": rear[:, 1],
        "speed": along - b.rR * yaw_rate * np.sin(roll),
        "pitch": np.arctan2(frame[:, 2, 0], frame[:, 2, 2]),
        "yaw_rate": yaw_rate,
    }


def _turn(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return (N, 3, 3) times (N, 3)."""
    turned: np.ndarray = np.einsum("nij,nj->ni", matrices, vectors)
    return turned


def _down(across: np.ndarray) -> np.ndarray:
    """Return the steepest direction down in the planes across (N, 3)."""
    up = Z - across[:, 2:3] * across
    down: np.ndarray = -up / np.linalg.norm(up, axis=-1, keepdims=True)
    return down


def _quaternion(matrices: np.ndarray) -> np.ndarray:
    """Return (N, 4), w first, of bicycles that stand: any yaw, a roll below a quarter turn."""
    m = matrices
    w = 1.0 + m[:, 0, 0] + m[:, 1, 1] + m[:, 2, 2]
    x = 1.0 + m[:, 0, 0] - m[:, 1, 1] - m[:, 2, 2]
    z = 1.0 - m[:, 0, 0] - m[:, 1, 1] + m[:, 2, 2]
    first = np.column_stack(
        [w, m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]]
    )
    last = np.column_stack(
        [m[:, 1, 0] - m[:, 0, 1], m[:, 0, 2] + m[:, 2, 0], m[:, 1, 2] + m[:, 2, 1], z]
    )
    found = np.where((w > np.maximum(x, 0.2))[:, None], first, last)
    unit: np.ndarray = found / np.linalg.norm(found, axis=-1, keepdims=True)
    return unit


def _matrix(quaternions: np.ndarray) -> np.ndarray:
    """Return the rotation matrices (N, 3, 3) of quaternions (N, 4)."""
    w, x, y, z = (quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)
