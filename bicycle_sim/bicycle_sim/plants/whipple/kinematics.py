"""Positions of a Whipple bicycle's parts, and its speeds in rolling without slip.

Two assemblies, each a frame and its wheel, are joined by the steering axis and roll on knife-edged
wheels. Each is described in the axes of its wheel's plane: x along the wheel's heading, y across
the plane, z down the plane. There its motion is four numbers, which `Rates` holds.

The bicycle has five speeds: yaw, lean, pitch and steer rate, and the rear contact's along its
heading. The front wheel must neither slip sideways nor leave the road, which gives yaw and pitch
rate. So three are free, lean rate, steer rate and speed: every rate is a sum of its partial rates
times these.

The equations are their own mirror image, so they hold for y to the right with angles positive to
the right, as the literature has it, and for y to the left with the paper's angles, as they are
used here.

`whipple_lanes.h` has the same operations in the same order, so both give the same bits. All values
are floats, arrays (N,) or torch tensors; `xp` is the module with their square root.
"""

from __future__ import annotations

from types import ModuleType
from typing import NamedTuple

import numpy as np

from bicycle_sim.plants.base import Array
from bicycle_sim.plants.whipple.constants import Constants
from bicycle_sim.plants.whipple.trigonometry import sine_cosine

Vector = tuple[Array, Array, Array]


class Pose(NamedTuple):
    """Coordinates that the equations need, and the free speeds."""

    lean: Array
    pitch: Array
    """rad, nose up; zero on an upright bicycle with straight steering."""
    steer: Array
    lean_rate: Array
    steer_rate: Array
    speed: Array
    rider_lean: Array = 0.0
    """rad, against the rear frame."""
    rider_rate: Array = 0.0


class Rates(NamedTuple):
    """Motion of an assembly in its wheel's plane, or its partial rates for one speed."""

    ahead: Array
    """m/s of the wheel's centre along its heading; minus the radius times the wheel's spin."""
    lean: Array
    """rad/s about x, the plane's leaning."""
    pitch: Array
    """rad/s of the frame about y."""
    turn: Array
    """rad/s about z."""


class Rolling(NamedTuple):
    """A pose's geometry and the partial rates that rolling leaves."""

    sine: Vector
    """Sines of lean, pitch (with the tilt of the steering axis) and steer."""
    cosine: Vector
    upright: tuple[Array, Array, Array]
    """Components of the road's normal across and along the front wheel's plane, and one over the
    latter."""
    front_pitch: tuple[Array, Array]
    """Sine and cosine of the front frame's pitch in its wheel's plane."""
    to_front: Vector
    """m from the rear to the front wheel's centre, front frame's axes."""
    per_yaw: Rates
    """Front assembly's partial rates for yaw rate; below for pitch rate."""
    per_pitch: Rates
    yaw_lever: Array
    """m of side slip of the front wheel per yaw; it cannot turn the bicycle where it is zero."""
    pitch_lever: Array
    """m that the front contact sinks per pitch."""
    pitch_slip: Array
    """m of side slip of the front wheel per pitch."""
    inverse: tuple[Array, Array]
    """1/m, one over `yaw_lever` and `pitch_lever`."""
    yaw: Vector
    """Yaw rate per lean rate, steer rate and speed."""
    pitch: tuple[Array, Array]
    """Pitch rate per lean rate and steer rate; speed makes none."""
    front: tuple[Rates, Rates, Rates]
    """Front assembly's partial rates for lean rate, steer rate and speed."""


def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def cross_plane(a: Vector, x: Array, z: Array) -> Vector:
    """Return a x (x, 0, z)."""
    return a[1] * z, a[2] * x - a[0] * z, -(a[1] * x)


def about_z(a: Vector, sine: Array, cosine: Array) -> Vector:
    """Return a vector in axes that are turned about z."""
    return cosine * a[0] + sine * a[1], cosine * a[1] - sine * a[0], a[2]


def about_y(a: Vector, sine: Array, cosine: Array) -> Vector:
    """Return a vector in axes that are turned about y."""
    return cosine * a[0] - sine * a[2], a[1], sine * a[0] + cosine * a[2]


def rolling(k: Constants, lean: Array, pitch: Array, steer: Array, xp: ModuleType = np) -> Rolling:
    """Return the geometry of a pose and its partial rates."""
    s1, c1 = sine_cosine(lean)
    s2, c2 = sine_cosine(k.tilt + pitch)
    s3, c3 = sine_cosine(steer)
    # In the front frame's axes: into the road, along the heading, across the rear wheel.
    down = about_z((-(c1 * s2), s1, c1 * c2), s3, c3)
    forward = c3 * c2, -(s3 * c2), s2
    # The front wheel's plane: z points down it most steeply, x is level.
    steep = xp.sqrt(down[0] * down[0] + down[2] * down[2])
    flat = 1.0 / steep
    sp, cp = -(down[0] * flat), down[2] * flat
    to_front = k.axis_forward * c3 + k.fork_offset, -(k.axis_forward * s3), k.axis_down

    # Velocity of the front wheel's centre per yaw, lean and pitch rate. The rear wheel's centre
    # moves by -(rear_radius s1) along the heading per yaw rate and sideways per lean rate.
    back = -(k.rear_radius * s1)
    swept = cross(down, to_front)
    by_yaw = (
        back * forward[0] + swept[0],
        back * forward[1] + swept[1],
        back * forward[2] + swept[2],
    )
    swept = cross(forward, to_front)
    by_lean = k.rear_radius * s3 + swept[0], k.rear_radius * c3 + swept[1], swept[2]
    by_pitch = c3 * k.axis_down, -(s3 * k.axis_down), s3 * to_front[1] - c3 * to_front[0]

    def along(a: Vector) -> Array:
        return cp * a[0] + sp * a[2]

    def into(a: Vector) -> Array:
        return cp * a[2] - sp * a[0]

    heading = along(forward)
    per_yaw = Rates(along(by_yaw), 0.0, down[1], steep)
    per_lean = Rates(along(by_lean), heading, forward[1], into(forward))
    per_pitch = Rates(along(by_pitch), cp * s3, c3, -(sp * s3))
    per_steer = Rates(0.0, sp, 0.0, cp)
    per_speed = Rates(heading, 0.0, 0.0, 0.0)

    # The contact's material point rests: no slip across the wheel, no motion into the road.
    lean_slip = by_lean[1] - k.front_radius * per_lean.lean
    pitch_slip = by_pitch[1] - k.front_radius * per_pitch.lean
    steer_slip = k.fork_offset - k.front_radius * sp
    lean_sinks = down[1] * lean_slip + steep * into(by_lean)
    pitch_sinks = down[1] * pitch_slip + steep * into(by_pitch)
    steer_sinks = down[1] * steer_slip
    inverse = 1.0 / by_yaw[1], 1.0 / pitch_sinks
    pitch_lean = -(lean_sinks * inverse[1])
    pitch_steer = -(steer_sinks * inverse[1])
    yaw_lean = -((lean_slip + pitch_slip * pitch_lean) * inverse[0])
    yaw_steer = -((steer_slip + pitch_slip * pitch_steer) * inverse[0])
    yaw_speed = -(forward[1] * inverse[0])

    def front(own: Rates, yaw: Array, pitch_rate: Array) -> Rates:
        """Partial rates of a free speed that makes so much yaw and pitch rate."""
        return Rates(
            own.ahead + (yaw * per_yaw.ahead + pitch_rate * per_pitch.ahead),
            own.lean + pitch_rate * per_pitch.lean,
            own.pitch + (yaw * per_yaw.pitch + pitch_rate * per_pitch.pitch),
            own.turn + (yaw * per_yaw.turn + pitch_rate * per_pitch.turn),
        )

    return Rolling(
        sine=(s1, s2, s3),
        cosine=(c1, c2, c3),
        upright=(down[1], steep, flat),
        front_pitch=(sp, cp),
        to_front=to_front,
        per_yaw=per_yaw,
        per_pitch=per_pitch,
        yaw_lever=by_yaw[1],
        pitch_lever=pitch_sinks,
        pitch_slip=pitch_slip,
        inverse=inverse,
        yaw=(yaw_lean, yaw_steer, yaw_speed),
        pitch=(pitch_lean, pitch_steer),
        front=(
            front(per_lean, yaw_lean, pitch_lean),
            front(per_steer, yaw_steer, pitch_steer),
            Rates(
                per_speed.ahead + yaw_speed * per_yaw.ahead,
                0.0,
                yaw_speed * per_yaw.pitch,
                yaw_speed * per_yaw.turn,
            ),
        ),
    )


def front_height(k: Constants, r: Rolling) -> Array:
    """Return the depth of the front contact below the road, m; zero in a possible pose."""
    across, steep, _ = r.upright
    sp, cp = r.front_pitch
    # The road's normal in the front frame's axes is (-steep sp, across, steep cp).
    front = steep * (cp * r.to_front[2] - sp * r.to_front[0]) + across * r.to_front[1]
    return front + k.front_radius * steep - k.rear_radius * r.cosine[0]


def front_contact(k: Constants, r: Rolling) -> tuple[Array, Array]:
    """Return the way from the rear to the front contact, m: along the heading, and across it."""
    s1, s2, s3 = r.sine
    c1, c2, c3 = r.cosine
    sp, cp = r.front_pitch
    x = r.to_front[0] - k.front_radius * sp
    z = r.to_front[2] + k.front_radius * cp
    bx, by = c3 * x - s3 * r.to_front[1], s3 * x + c3 * r.to_front[1]
    forward = c2 * bx + s2 * z
    below = c2 * z - s2 * bx - k.rear_radius
    return forward, c1 * by - s1 * below


class Change(NamedTuple):
    """Change of an assembly's motion at constant free speeds."""

    up: Vector
    """rad/s^2, angular acceleration of the frame."""
    base: Vector
    """m/s^2, acceleration of the wheel's centre."""
    ahead: Array
    """m/s^2, change of `Rates.ahead`."""
