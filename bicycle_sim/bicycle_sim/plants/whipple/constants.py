"""The numbers that the equations take, from the parameters that people measure.

The rear frame's axes are turned so that z is the steering axis (Moore 2012): x_B, z_B of a point
then never change with the steering. A frame and its wheel are one rigid body here, whose inertia
about the axle leaves the wheel's out: the wheel's spin is a rotor of its own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bicycle_sim.plants.base import Array
from bicycle_sim.plants.whipple.parameters import Bicycle, Parameters, Rider
from bicycle_sim.plants.whipple.trigonometry import decay, sine_cosine


class Constants(NamedTuple):
    """Values for the rows of the table that `whipple.cpp` takes, in its order."""

    gravity: Array
    """m/s^2 into the road."""
    tilt: Array
    """rad, of the steering axis."""
    rear_radius: Array
    front_radius: Array
    rear_curvature: Array
    """1/m, one over the radius; zero for a skate."""
    front_curvature: Array
    axis_forward: Array
    """m from the rear wheel's centre to the steering axis, along x_B (d1)."""
    axis_down: Array
    """m from the rear to the front wheel's centre, along the steering axis (d2)."""
    fork_offset: Array
    """m from the steering axis to the front wheel's centre, along x_H (d3)."""
    rear_mass: Array
    """kg of frame and wheel."""
    rear_rotor: Array
    """kg, the wheel's inertia about its axle over the radius squared; zero for a skate."""
    rear_x: Array
    """kg m, mass times the way from the wheel's centre to the centre of mass."""
    rear_z: Array
    rear_xx: Array
    """kg m^2 about the wheel's centre."""
    rear_yy: Array
    rear_zz: Array
    rear_xz: Array
    front_mass: Array
    front_rotor: Array
    front_x: Array
    front_z: Array
    front_xx: Array
    front_yy: Array
    front_zz: Array
    front_xz: Array
    turn_limit: Array
    """m, the least lever with which the front wheel can still turn the bicycle."""
    friction: Array
    stiction: Array
    damping: Array
    stop: Array
    motor_limit: Array
    motor_share: Array
    """Share of the missing torque that the motor gains in half a substep."""
    motor_change: Array
    """N m, largest change in half a substep."""
    motor_dead: Array
    motor_instant: Array
    """1 where the torque follows at once, else 0."""
    delay_share: Array
    """Share of a control period in which the command before still rules."""
    gear: Array
    power: Array
    brake: Array
    governor: Array
    drag: Array
    """kg/m, force per square of the air's speed along the bicycle; below, from the side."""
    side_drag: Array
    pressure_forward: Array
    """m from the rear wheel's centre to where the air presses, in its plane."""
    pressure_down: Array
    rear_rolling: Array
    """N of rolling resistance."""
    front_rolling: Array
    gravity_x: Array
    """m/s^2 along the road towards +x."""
    gravity_y: Array
    rider_mass: Array
    rider_x: Array
    """m from the rear wheel's centre to the rider's axis, below its centre of mass; level axes."""
    rider_z: Array
    rider_down: Array
    """m from that axis down to the rider's centre of mass, below zero."""
    rider_xx: Array
    rider_yy: Array
    rider_zz: Array
    rider_xz: Array
    tilt_sine: Array
    tilt_cosine: Array
    passive_stiffness: Array
    passive_damping: Array
    muscle_stiffness: Array
    """N m per sine of the lean that is missing."""
    muscle_damping: Array
    muscle_weight: Array
    """N m that hold the rider's weight, per sine of its lean from the vertical."""
    muscle_limit: Array
    muscle_gain: Array
    """Sine of the rider's lean per metre of displacement of the common centre of mass."""


UNLIMITED = 1e30
"""Value of a limit that is disabled."""


def constants(p: Parameters) -> Constants:
    """Return the constants of N bicycles, each a float or (N,)."""
    b, steering, motor, drive, air = p.bicycle, p.steering, p.motor, p.drive, p.resistance
    sine, cosine = sine_cosine(b.lam)
    axis_forward = cosine * (b.c + b.w) - b.rR * sine
    fork_offset = b.rF * sine - cosine * b.c
    axis_down = (b.rR - b.rF + (axis_forward + fork_offset) * sine) / cosine
    rear = _body(b.xB, b.zB + b.rR, b.mB, _inertia(b, "B"), b.mR, b.IRxx, sine, cosine)
    front = _body(b.xH - b.w, b.zH + b.rF, b.mH, _inertia(b, "H"), b.mF, b.IFxx, sine, cosine)
    steepness = np.sqrt(1.0 + p.road.grade_x * p.road.grade_x + p.road.grade_y * p.road.grade_y)
    half = 0.5 * p.time_step / p.substeps
    load = air.rolling * b.g * _total_mass(p)
    front_share = _mass_forward(p) / b.w
    return Constants(
        gravity=b.g / steepness,
        tilt=b.lam,
        rear_radius=b.rR,
        front_radius=b.rF,
        rear_curvature=_inverse(b.rR),
        front_curvature=_inverse(b.rF),
        axis_forward=axis_forward,
        axis_down=axis_down,
        fork_offset=fork_offset,
        **{f"rear_{name}": value for name, value in rear.items()},
        rear_rotor=b.IRyy * _inverse(b.rR) * _inverse(b.rR),
        **{f"front_{name}": value for name, value in front.items()},
        front_rotor=b.IFyy * _inverse(b.rF) * _inverse(b.rF),
        turn_limit=0.05 * b.w,
        friction=steering.friction,
        stiction=np.maximum(steering.stiction, steering.friction),
        damping=steering.damping,
        stop=steering.stop,
        motor_limit=_limit(motor.limit),
        motor_share=_share(half, motor.lag),
        motor_change=_limit(motor.rate) * half,
        motor_dead=motor.dead_band,
        motor_instant=np.where((motor.lag == 0.0) & (np.asarray(motor.rate) == 0.0), 1.0, 0.0),
        delay_share=delay_steps(p)[1],
        gear=drive.gear,
        power=drive.power,
        brake=drive.brake,
        governor=drive.governor,
        drag=0.5 * air.air_density * air.drag_area,
        side_drag=0.5 * air.air_density * air.side_area,
        pressure_forward=air.pressure_forward,
        pressure_down=b.rR - air.pressure_height,
        rear_rolling=load * (1.0 - front_share),
        front_rolling=load * front_share,
        gravity_x=-b.g * p.road.grade_x / steepness,
        gravity_y=-b.g * p.road.grade_y / steepness,
        **_rider(p, sine, cosine),
    )


def delay_steps(p: Parameters) -> tuple[Array, Array]:
    """Whole control periods of the delay, and the share of one that is left."""
    periods = np.asarray(p.delay) / p.time_step
    whole = np.floor(periods + 1e-9)
    return whole.astype(int), np.maximum(periods - whole, 0.0) * 1.0


def _inverse(radius: Array) -> Array:
    """Return 1/radius; zero for a zero radius."""
    safe = np.where(np.equal(radius, 0.0), 1.0, radius)
    return np.where(np.equal(radius, 0.0), 0.0, 1.0 / safe)


def _limit(value: Array) -> Array:
    """Return the limit; a very large one for zero, which means none."""
    return np.where(np.equal(value, 0.0), UNLIMITED, value)


def _share(time: float, lag: Array) -> Array:
    """Return 1 - exp(-time/lag); 1 without a lag."""

    def one(value: float) -> float:
        return 1.0 - decay(time / value) if value > 0.0 else 1.0

    return np.array([one(value) for value in lag]) if np.ndim(lag) else one(float(lag))


def _turned(forward: Array, down: Array, sine: Array, cosine: Array) -> tuple[Array, Array]:
    """Return a point of level axes in axes whose z is the steering axis."""
    return cosine * forward - sine * down, sine * forward + cosine * down


def _inertia(bicycle: Bicycle, body: str) -> tuple[Array, Array, Array, Array]:
    """Return xx, yy, zz and xz of a frame."""
    xx, yy, zz, xz = (getattr(bicycle, f"I{body}{axis}") for axis in ("xx", "yy", "zz", "xz"))
    return xx, yy, zz, xz


def _body(
    forward: Array,
    down: Array,
    mass: Array,
    inertia: tuple[Array, Array, Array, Array],
    wheel_mass: Array,
    wheel_inertia: Array,
    sine: Array,
    cosine: Array,
) -> dict[str, Array]:
    """Combine a frame and its wheel to one body.

    Args:
        forward: m from the wheel's centre to the frame's centre of mass, level axes.
        down: the same, downwards.
        mass: kg of the frame.
        inertia: kg m^2 of the frame, xx, yy, zz and xz in level axes.
        wheel_mass: kg.
        wheel_inertia: kg m^2 about a diameter.
        sine: of the tilt of the steering axis.
        cosine: the same.
    """
    x, z = _turned(forward, down, sine, cosine)
    level_xx, yy, level_zz, level_xz = inertia
    both, across = 2.0 * (sine * cosine) * level_xz, sine * cosine * (level_xx - level_zz)
    xx = cosine * cosine * level_xx - both + sine * sine * level_zz
    zz = sine * sine * level_xx + both + cosine * cosine * level_zz
    xz = across + (cosine * cosine - sine * sine) * level_xz
    return {
        "mass": mass + wheel_mass,
        "x": mass * x,
        "z": mass * z,
        "xx": xx + wheel_inertia + mass * z * z,
        "yy": yy + mass * (x * x + z * z),
        "zz": zz + wheel_inertia + mass * x * x,
        "xz": xz - mass * x * z,
    }


def _total_mass(p: Parameters) -> Array:
    return p.bicycle.mass + (p.rider.mG if p.rider is not None else 0.0)


def _mass_forward(p: Parameters) -> Array:
    moment = p.bicycle.mass * p.bicycle.mass_forward
    if p.rider is not None:
        moment = moment + p.rider.mG * p.rider.xG
    return moment / _total_mass(p)


def _rider(p: Parameters, sine: Array, cosine: Array) -> dict[str, Array]:
    """Return the constants of a leaning rider; zeros without one."""
    names = Constants._fields[Constants._fields.index("rider_mass") :]
    found: dict[str, Array] = dict.fromkeys(names, 0.0)
    found["tilt_sine"], found["tilt_cosine"] = sine, cosine
    if p.rider is None:
        return found
    g: Rider = p.rider
    down = g.zG - g.zP
    about_axis = g.IGxx + g.mG * down * down
    found.update(
        rider_mass=g.mG,
        rider_x=g.xG,
        rider_z=g.zP + p.bicycle.rR,
        rider_down=down,
        rider_xx=g.IGxx,
        rider_yy=g.IGyy,
        rider_zz=g.IGzz,
        rider_xz=g.IGxz,
        passive_stiffness=g.stiffness,
        passive_damping=g.damping,
        muscle_stiffness=about_axis * g.frequency * g.frequency,
        muscle_damping=2.0 * g.damping_ratio * about_axis * g.frequency,
        muscle_weight=np.where(np.equal(g.frequency, 0.0), 0.0, -(g.mG * p.bicycle.g * down)),
        muscle_limit=g.torque_limit,
        muscle_gain=-(_total_mass(p) / (g.mG * down)),
    )
    return found


def table(values: Constants, count: int | None) -> np.ndarray:
    """Return the rows for `whipple.cpp`: (rows, N), or (rows, 1) if all bicycles are alike."""
    wide = count if count is not None else 1
    return np.array([np.broadcast_to(np.asarray(row, dtype=float), wide) for row in values])
