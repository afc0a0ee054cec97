"""The nonlinear equations of motion of the Whipple-Carvallo bicycle, Kane's method in numbers.

Forces, and masses times accelerations, are projected on the partial rates of the free speeds (Kane
and Levinson 1985), which gives three equations for the free accelerations, four with a rider who
leans. `kinematics.py` has the axes and the partial rates.

`whipple_lanes.h` has the same operations in the same order, so both give the same bits.
"""

from __future__ import annotations

from typing import NamedTuple

from bicycle_sim.plants.base import Array
from bicycle_sim.plants.whipple.constants import Constants
from bicycle_sim.plants.whipple.kinematics import (
    Change,
    Pose,
    Rates,
    Rolling,
    Vector,
    about_y,
    about_z,
    cross,
)
from bicycle_sim.plants.whipple.leaning_rider import follows, shares, without_rider


class Forces(NamedTuple):
    """Loads besides weight; vectors in the axes of the rear wheel's plane."""

    steer_torque: Array = 0.0
    """N m between rear and front frame."""
    rim_force: Array = 0.0
    """N between rear frame and rear wheel, at its rim, forward."""
    road_forward: Array = 0.0
    """m/s^2 of gravity along the road, forward."""
    road_across: Array = 0.0
    """m/s^2 of gravity along the road, level and across the heading."""
    force: Vector = (0.0, 0.0, 0.0)
    """N on the rear frame, and below N m about the rear wheel's centre."""
    torque: Vector = (0.0, 0.0, 0.0)
    rear_rolling: Array = 0.0
    """N against the rolling of the rear wheel, and below of the front one."""
    front_rolling: Array = 0.0
    rider_torque: Array = 0.0
    """N m between rear frame and rider."""


class Motion(NamedTuple):
    """Rates of the coordinates and of the free speeds."""

    yaw_rate: Array
    pitch_rate: Array
    front_spin: Array
    """m/s of the front rim against the front frame, forward."""
    lean: Array
    """rad/s^2."""
    steer: Array
    """rad/s^2."""
    speed: Array
    """m/s^2."""
    rider: Array
    """rad/s^2."""
    give: tuple[Array, Array, Array, Array]
    """Change of lean, steer, speed and rider acceleration per N m of steer torque."""
    mass: list[Array]
    """Mass matrix of lean, steer and speed: 11, 12, 13, 22, 23, 33."""


class _Frame(NamedTuple):
    """An assembly as the equations take it; vectors in the axes of its wheel's plane."""

    mass: Array
    radius: Array
    rotor: Array
    """kg, the wheel's spin inertia over the radius squared."""
    x: Array
    """kg m, mass times the centre of mass, from the wheel's centre."""
    z: Array
    xx: Array
    """kg m^2 about the wheel's centre."""
    yy: Array
    zz: Array
    xz: Array


def _rear(k: Constants, sine: Array, cosine: Array) -> _Frame:
    return _frame(
        (k.rear_mass, k.rear_radius, k.rear_rotor, k.rear_x, k.rear_z),
        (k.rear_xx, k.rear_yy, k.rear_zz, k.rear_xz),
        sine,
        cosine,
    )


def _front(k: Constants, sine: Array, cosine: Array) -> _Frame:
    return _frame(
        (k.front_mass, k.front_radius, k.front_rotor, k.front_x, k.front_z),
        (k.front_xx, k.front_yy, k.front_zz, k.front_xz),
        sine,
        cosine,
    )


def _frame(
    body: tuple[Array, ...], inertia: tuple[Array, ...], sine: Array, cosine: Array
) -> _Frame:
    """Return the assembly, pitched in its wheel's plane."""
    mass, radius, rotor, x, z = body
    xx, yy, zz, xz = inertia
    tilt = sine * (zz - xx) + cosine * (2.0 * xz)
    along = xx + sine * tilt
    return _Frame(
        mass=mass,
        radius=radius,
        rotor=rotor,
        x=cosine * x + sine * z,
        z=cosine * z - sine * x,
        xx=along,
        yy=yy,
        zz=(xx + zz) - along,
        xz=cosine * tilt - xz,
    )


def _load(
    f: _Frame, w: Rates, change: Change, gravity: Vector
) -> tuple[Array, Array, Array, Array]:
    """Weight less mass times acceleration, per rate of the assembly."""
    bx, by, bz = (
        gravity[0] - change.base[0],
        gravity[1] - change.base[1],
        gravity[2] - change.base[2],
    )
    ux, uy, uz = w.pitch * f.z, w.turn * f.x - w.lean * f.z, -(w.pitch * f.x)
    ax, ay, az = change.up
    force_x = f.mass * bx - ay * f.z - (w.pitch * uz - w.turn * uy)
    force_y = f.mass * by - (az * f.x - ax * f.z) - (w.turn * ux - w.lean * uz)
    hx = f.xx * w.lean + f.xz * w.turn
    hy = f.yy * w.pitch - (f.rotor * f.radius) * w.ahead
    hz = f.xz * w.lean + f.zz * w.turn
    torque_x = -(f.z * by) - (f.xx * ax + f.xz * az) - (w.pitch * hz - w.turn * hy)
    torque_y = (f.z * bx - f.x * bz) - f.yy * ay - (w.turn * hx - w.lean * hz)
    torque_z = f.x * by - (f.xz * ax + f.zz * az) - (w.lean * hy - w.pitch * hx)
    return (
        force_x - f.rotor * change.ahead,
        f.radius * force_y + torque_x,
        torque_y,
        torque_z,
    )


def _projected(own: Rates, load: tuple[Array, Array, Array, Array], leans: bool = True) -> Array:
    """Return a load per unit of a free speed with these partial rates; lean counts if `leans`."""
    found = own.ahead * load[0] + own.pitch * load[2] + own.turn * load[3]
    return found + own.lean * load[1] if leans else found


def _momenta(f: _Frame, own: Rates, leans: bool = True) -> tuple[Array, Array, Array, Array]:
    """Momentum per rate that a unit of a free speed makes."""
    across = f.xz + f.radius * f.x
    ahead = (f.mass + f.rotor) * own.ahead + f.z * own.pitch
    pitch = f.z * own.ahead + f.yy * own.pitch
    if not leans:
        return ahead, across * own.turn, pitch, f.zz * own.turn
    heavy = f.xx + f.radius * (f.radius * f.mass - 2.0 * f.z)
    return ahead, heavy * own.lean + across * own.turn, pitch, across * own.lean + f.zz * own.turn


def motion(
    k: Constants,
    pose: Pose,
    forces: Forces,
    r: Rolling,
    extras: bool = False,
    leaning_rider: bool = False,
) -> Motion:
    """Return rates and accelerations of a pose.

    Args:
        k: of the bicycles.
        pose: where they are.
        forces: what acts on them besides weight.
        r: the `rolling` of that pose.
        extras: True if all of `forces` counts, not only steer torque, rim force and rider torque.
        leaning_rider: True if there is a rider who leans.
    """
    s1, s2, _ = r.sine
    c1, c2, _ = r.cosine
    lean_rate, steer_rate, speed = pose.lean_rate, pose.steer_rate, pose.speed
    yaw = r.yaw[0] * lean_rate + r.yaw[1] * steer_rate + r.yaw[2] * speed
    pitch = r.pitch[0] * lean_rate + r.pitch[1] * steer_rate
    back = -(k.rear_radius * s1)
    rear_partial = (
        Rates(back * r.yaw[0], 1.0, r.yaw[0] * s1 + r.pitch[0], r.yaw[0] * c1),
        Rates(back * r.yaw[1], 0.0, r.yaw[1] * s1 + r.pitch[1], r.yaw[1] * c1),
        Rates(back * r.yaw[2] + 1.0, 0.0, r.yaw[2] * s1, r.yaw[2] * c1),
    )
    rear = Rates(speed + back * yaw, lean_rate, yaw * s1 + pitch, yaw * c1)
    by_lean, by_steer, by_speed = r.front
    front = Rates(
        by_lean.ahead * lean_rate + by_steer.ahead * steer_rate + by_speed.ahead * speed,
        by_lean.lean * lean_rate + by_steer.lean * steer_rate,
        by_lean.pitch * lean_rate + by_steer.pitch * steer_rate + by_speed.pitch * speed,
        by_lean.turn * lean_rate + by_steer.turn * steer_rate + by_speed.turn * speed,
    )
    rear_change, front_change = _coasting(k, pose, r, yaw, pitch, rear, front)

    across, steep, _ = r.upright
    gravity: Vector = (0.0, k.gravity * s1, k.gravity * c1)
    gravity_front: Vector = (0.0, k.gravity * across, k.gravity * steep)
    if extras:
        gravity, gravity_front = _on_a_slope(gravity, gravity_front, forces, r)
    rear_frame, front_frame = _rear(k, s2, c2), _front(k, *r.front_pitch)
    rear_load = _load(rear_frame, rear, rear_change, gravity)
    front_load = _load(front_frame, front, front_change, gravity_front)
    if extras:
        rear_load = (
            rear_load[0] + (forces.force[0] - forces.rear_rolling),
            rear_load[1] + (k.rear_radius * forces.force[1] + forces.torque[0]),
            rear_load[2] + forces.torque[1],
            rear_load[3] + forces.torque[2],
        )
        front_load = (front_load[0] - forces.front_rolling, *front_load[1:])
    turned = forces.rim_force * k.rear_radius
    load = [
        (_projected(rear_partial[0], rear_load, False) + rear_load[1])
        + _projected(r.front[0], front_load)
        + r.pitch[0] * turned,
        _projected(rear_partial[1], rear_load, False)
        + _projected(r.front[1], front_load)
        + (r.pitch[1] * turned + forces.steer_torque),
        _projected(rear_partial[2], rear_load, False)
        + _projected(r.front[2], front_load, False)
        + forces.rim_force,
    ]
    mass = [
        one + other
        for one, other in zip(
            _rear_mass(rear_frame, rear_partial), _front_mass(front_frame, r.front), strict=True
        )
    ]
    spin = front.ahead + k.front_radius * front.pitch
    if not leaning_rider:
        lean_up, steer_up, speed_up, give = _solved(mass, load)
        return Motion(yaw, pitch, spin, lean_up, steer_up, speed_up, 0.0, (*give, 0.0), mass)
    rider_mass, rider_load = shares(
        k, pose.rider_lean, pose.rider_rate, r, rear, rear_change, gravity, rear_partial
    )
    rider_load[3] = rider_load[3] + forces.rider_torque
    mass, load, coupling = without_rider(mass, load, rider_mass, rider_load)
    lean_up, steer_up, speed_up, give = _solved(mass, load)
    rider_up = coupling.pull - follows(coupling, lean_up, steer_up, speed_up)
    rider_give = -follows(coupling, *give)
    return Motion(
        yaw, pitch, spin, lean_up, steer_up, speed_up, rider_up, (*give, rider_give), mass
    )


def _rear_mass(f: _Frame, own: tuple[Rates, Rates, Rates]) -> list[Array]:
    """Return the rear assembly's share of the mass matrix; only lean rate makes its plane lean."""
    across = f.xz + f.radius * f.x
    heavy = f.xx + f.radius * (f.radius * f.mass - 2.0 * f.z)
    lean, steer, speed = (_momenta(f, one, False) for one in own)
    lean = lean[0], lean[1] + heavy, lean[2], lean[3] + across
    return [
        _projected(own[0], lean, False) + lean[1],
        _projected(own[1], lean, False),
        _projected(own[2], lean, False),
        _projected(own[1], steer, False),
        _projected(own[2], steer, False),
        _projected(own[2], speed, False),
    ]


def _front_mass(f: _Frame, own: tuple[Rates, Rates, Rates]) -> list[Array]:
    """Return the front assembly's share; speed does not make its plane lean."""
    lean, steer = _momenta(f, own[0]), _momenta(f, own[1])
    speed = _momenta(f, own[2], False)
    return [
        _projected(own[0], lean),
        _projected(own[1], lean),
        _projected(own[2], lean, False),
        _projected(own[1], steer),
        _projected(own[2], steer, False),
        _projected(own[2], speed, False),
    ]


def _on_a_slope(
    gravity: Vector, gravity_front: Vector, forces: Forces, r: Rolling
) -> tuple[Vector, Vector]:
    """Gravity with its parts along the road, in both wheels' planes."""
    s1, s2, s3 = r.sine
    c1, c2, c3 = r.cosine
    forward, across = forces.road_forward, forces.road_across
    rear = forward, across * c1, -(across * s1)
    front = about_z(about_y(rear, s2, c2), s3, c3)
    sp, cp = r.front_pitch
    front = cp * front[0] + sp * front[2], front[1], cp * front[2] - sp * front[0]
    return (
        (gravity[0] + rear[0], gravity[1] + rear[1], gravity[2] + rear[2]),
        (gravity_front[0] + front[0], gravity_front[1] + front[1], gravity_front[2] + front[2]),
    )


def _coasting(
    k: Constants, pose: Pose, r: Rolling, yaw: Array, pitch: Array, rear: Rates, front: Rates
) -> tuple[Change, Change]:
    """Return the change of both assemblies' motions at constant free speeds.

    What is left then is what turning makes: centripetal and Coriolis accelerations, and the yaw
    and pitch accelerations that keep the front wheel rolling.
    """
    s1, s2, s3 = r.sine
    c1, c2, c3 = r.cosine
    across, steep, flat = r.upright
    sp, cp = r.front_pitch
    lean_rate, steer_rate = pose.lean_rate, pose.steer_rate

    # Rear assembly: its wheel's plane turns with yaw and lean.
    roll = yaw * s1
    leaning = k.rear_radius * lean_rate
    up = -(pitch * rear.turn), lean_rate * rear.turn, pitch * lean_rate - lean_rate * roll
    base = (
        -(2.0 * (leaning * rear.turn)),
        rear.ahead * rear.turn,
        leaning * lean_rate - rear.ahead * roll,
    )

    # Front wheel's centre, front frame's axes: carried by the rear frame, moved by the steering.
    turning = about_z(about_y((lean_rate, rear.pitch, rear.turn), s2, c2), s3, c3)
    carried = about_z(about_y(up, s2, c2), s3, c3)
    centre = about_z(about_y(base, s2, c2), s3, c3)
    swept = cross(carried, r.to_front)
    held = cross(turning, cross(turning, r.to_front))
    swing = steer_rate * k.fork_offset
    centre = (
        centre[0] + (swept[0] + held[0]) - (2.0 * (swing * turning[2]) + steer_rate * swing),
        centre[1] + (swept[1] + held[1]),
        centre[2] + (swept[2] + held[2]) + 2.0 * (swing * turning[0]),
    )
    carried = (
        carried[0] + steer_rate * turning[1],
        carried[1] - steer_rate * turning[0],
        carried[2],
    )

    # In its wheel's plane: to roll on, the centre must accelerate with the plane's turning.
    up_front = cp * carried[0] + sp * carried[2], carried[1], cp * carried[2] - sp * carried[0]
    plane = (front.turn * flat) * across
    along = cp * centre[0] + sp * centre[2]
    into = cp * centre[2] - sp * centre[0]
    leaned = up_front[0] + (front.pitch - plane) * front.turn
    slip = centre[1] - (front.ahead * front.turn + k.front_radius * leaned)
    sunk = k.front_radius * (front.lean * front.lean) - front.ahead * plane
    pitch_up = -((across * slip + steep * (into - sunk)) * r.inverse[1])
    yaw_up = -((slip + r.pitch_slip * pitch_up) * r.inverse[0])

    back = k.rear_radius * (yaw_up * s1)
    rear_change = Change(
        up=(up[0], up[1] + (yaw_up * s1 + pitch_up), up[2] + yaw_up * c1),
        base=(base[0] - back, base[1], base[2]),
        ahead=-(leaning * rear.turn) - back,
    )
    leaned = leaned + pitch_up * r.per_pitch.lean
    along = along + (yaw_up * r.per_yaw.ahead + pitch_up * r.per_pitch.ahead)
    front_change = Change(
        up=(
            up_front[0] + pitch_up * r.per_pitch.lean,
            up_front[1] + (yaw_up * r.per_yaw.pitch + pitch_up * r.per_pitch.pitch),
            up_front[2] + (yaw_up * r.per_yaw.turn + pitch_up * r.per_pitch.turn),
        ),
        base=(along, front.ahead * front.turn + k.front_radius * leaned, sunk),
        ahead=along + k.front_radius * (front.lean * front.turn),
    )
    return rear_change, front_change


def _solved(
    mass: list[Array], load: list[Array]
) -> tuple[Array, Array, Array, tuple[Array, Array, Array]]:
    """Return accelerations of lean, steer and speed, and their rates per N m of steer torque."""
    m11, m12, m13, m22, m23, m33 = mass
    a11 = m22 * m33 - m23 * m23
    a12 = m23 * m13 - m12 * m33
    a13 = m12 * m23 - m22 * m13
    a22 = m11 * m33 - m13 * m13
    a23 = m12 * m13 - m11 * m23
    a33 = m11 * m22 - m12 * m12
    scale = 1.0 / (m11 * a11 + m12 * a12 + m13 * a13)
    lean = (a11 * load[0] + a12 * load[1] + a13 * load[2]) * scale
    steer = (a12 * load[0] + a22 * load[1] + a23 * load[2]) * scale
    speed = (a13 * load[0] + a23 * load[1] + a33 * load[2]) * scale
    return lean, steer, speed, (a12 * scale, a22 * scale, a23 * scale)
