"""A rider's upper body on a Whipple bicycle: one more body and one more free speed, its lean rate.

The body's axes are those of the rear frame, level on an upright bicycle, then leaned; its
reference point is on the axis of the lean. About riding straight the matrices are those of
Moore 2012.
"""

from __future__ import annotations

from typing import NamedTuple

from bicycle_sim.plants.base import Array
from bicycle_sim.plants.whipple.constants import Constants
from bicycle_sim.plants.whipple.kinematics import (
    Change,
    Rates,
    Rolling,
    Vector,
    about_y,
    cross,
    cross_plane,
)
from bicycle_sim.plants.whipple.trigonometry import sine_cosine


def shares(
    k: Constants,
    rider_lean: Array,
    rider_rate: Array,
    r: Rolling,
    rear: Rates,
    change: Change,
    gravity: Vector,
    partial: tuple[Rates, Rates, Rates],
) -> tuple[list[Array], list[Array]]:
    """Return the rider's part of the mass matrix and of the loads of four speeds.

    Args:
        k: of the bicycles.
        rider_lean: rad against the rear frame.
        rider_rate: rad/s.
        r: the pose's geometry.
        rear: the rear assembly's rates.
        change: how they change while the free speeds stay.
        gravity: m/s^2, axes of the rear wheel's plane.
        partial: the rear assembly's partial rates for lean rate, steer rate and speed.

    Returns:
        The upper triangle of the matrix, row by row, and the loads; the fourth speed is the
        rider's lean rate.
    """
    s4, c4 = sine_cosine(rider_lean)
    # The rear frame's pitch without the tilt of the steering axis.
    s2 = r.sine[1] * k.tilt_cosine - r.cosine[1] * k.tilt_sine
    c2 = r.cosine[1] * k.tilt_cosine + r.sine[1] * k.tilt_sine
    x, z, down = k.rider_x, k.rider_z, k.rider_down

    def leaned(a: Vector) -> Vector:
        return a[0], c4 * a[1] + s4 * a[2], c4 * a[2] - s4 * a[1]

    def inertia(a: Vector) -> Vector:
        return (
            k.rider_xx * a[0] + k.rider_xz * a[2],
            k.rider_yy * a[1],
            k.rider_xz * a[0] + k.rider_zz * a[2],
        )

    def dot(a: Vector, b: Vector) -> Array:
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

    velocity: list[Vector] = []
    turning: list[Vector] = []
    for own in partial:
        about = about_y((own.lean, own.pitch, own.turn), s2, c2)
        base = about_y((own.ahead, k.rear_radius * own.lean, 0.0), s2, c2)
        swept = cross_plane(about, x, z)
        point = leaned((base[0] + swept[0], base[1] + swept[1], base[2] + swept[2]))
        about = leaned(about)
        turning.append(about)
        velocity.append((point[0] + about[1] * down, point[1] - about[0] * down, point[2]))
    turning.append((1.0, 0.0, 0.0))
    velocity.append((0.0, -down, 0.0))

    carried = about_y((rear.lean, rear.pitch, rear.turn), s2, c2)
    up = about_y(change.up, s2, c2)
    base = about_y(change.base, s2, c2)
    swept, held = cross_plane(up, x, z), cross(carried, cross_plane(carried, x, z))
    base = leaned(
        (
            base[0] + (swept[0] + held[0]),
            base[1] + (swept[1] + held[1]),
            base[2] + (swept[2] + held[2]),
        )
    )
    carried, up = leaned(carried), leaned(up)
    rate = rider_rate
    w = carried[0] + rate, carried[1], carried[2]
    up = up[0], up[1] + rate * carried[2], up[2] - rate * carried[1]
    swing = w[1] * down, -(w[0] * down)
    com = (
        base[0] + up[1] * down - w[2] * swing[1],
        base[1] - up[0] * down + w[2] * swing[0],
        base[2] + (w[0] * swing[1] - w[1] * swing[0]),
    )
    pull = leaned(about_y(gravity, s2, c2))
    force = (
        k.rider_mass * (pull[0] - com[0]),
        k.rider_mass * (pull[1] - com[1]),
        k.rider_mass * (pull[2] - com[2]),
    )
    change_up, change_turn = inertia(up), cross(w, inertia(w))
    torque = (
        -(change_up[0] + change_turn[0]),
        -(change_up[1] + change_turn[1]),
        -(change_up[2] + change_turn[2]),
    )
    load = [dot(v, force) + dot(t, torque) for v, t in zip(velocity, turning, strict=True)]
    momentum = [(k.rider_mass * v[0], k.rider_mass * v[1], k.rider_mass * v[2]) for v in velocity]
    angular = [inertia(t) for t in turning]
    mass = [
        dot(velocity[i], momentum[j]) + dot(turning[i], angular[j])
        for i in range(4)
        for j in range(i, 4)
    ]
    return mass, load


class Coupling(NamedTuple):
    """The rider's own equation, solved for its acceleration."""

    pull: Array
    """rad/s^2 with the bicycle at rest."""
    lean: Array
    """rad/s^2 less per unit of lean, steer and speed acceleration."""
    steer: Array
    speed: Array


def without_rider(
    mass: list[Array], load: list[Array], rider_mass: list[Array], rider_load: list[Array]
) -> tuple[list[Array], list[Array], Coupling]:
    """Return the equations of the bicycle's free speeds after the rider's is solved.

    Args:
        mass: 11, 12, 13, 22, 23, 33 of the bicycle.
        load: its three loads.
        rider_mass: see `shares`.
        rider_load: see `shares`.
    """
    m = rider_mass
    share = 1.0 / m[9]
    c1, c2, c3 = m[3] * share, m[6] * share, m[8] * share
    left = [
        (mass[0] + m[0]) - c1 * m[3],
        (mass[1] + m[1]) - c1 * m[6],
        (mass[2] + m[2]) - c1 * m[8],
        (mass[3] + m[4]) - c2 * m[6],
        (mass[4] + m[5]) - c2 * m[8],
        (mass[5] + m[7]) - c3 * m[8],
    ]
    pull = rider_load[3]
    pulled = [
        (load[0] + rider_load[0]) - c1 * pull,
        (load[1] + rider_load[1]) - c2 * pull,
        (load[2] + rider_load[2]) - c3 * pull,
    ]
    return left, pulled, Coupling(pull * share, c1, c2, c3)


def follows(c: Coupling, lean: Array, steer: Array, speed: Array) -> Array:
    """Return the decrease of the rider's acceleration, rad/s^2, due to the bicycle's."""
    return c.lean * lean + c.steer * steer + c.speed * speed
