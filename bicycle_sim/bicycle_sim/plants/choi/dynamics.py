"""Equations 1-13 of the paper for N bicycles at once, as corrected by the errata table.

Everything is in the paper's signs: lean omega > 0 to the left, steering theta > 0 to the left,
heading psi counter-clockwise from +y. `xp` is numpy, or torch for tensors on any device.
"""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import numpy as np

from bicycle_common.geometry import Array, heading_between
from bicycle_sim.plants.base import FALL_ANGLE, BodyState
from bicycle_sim.plants.choi.parameters import Constants, Physics

State = BodyState
"""N bicycles; tensors may stand for the arrays."""

Curvature = tuple[Array, Array, Array]
"""1/r_f, 1/r_b and 1/r_CM, each (N,), 1/m."""


def upright(
    rear_x: Array,
    rear_y: Array,
    heading: Array,
    speed: Array,
    constants: Constants,
    xp: ModuleType = np,
) -> State:
    """Return N upright bicycles with straight handlebars; all arguments of shape (N,).

    The heading is recomputed from the two contacts, as in every step, so that a state can be
    rebuilt to the bit from its contacts alone.
    """
    front_x = rear_x - constants.wheelbase * xp.sin(heading)
    front_y = rear_y + constants.wheelbase * xp.cos(heading)
    zero = xp.zeros_like(rear_x)
    return State(
        lean_angle=zero,
        lean_rate=zero,
        lean_acceleration=zero,
        steer_angle=zero,
        steer_rate=zero,
        heading=heading_between(rear_x, rear_y, front_x, front_y, xp),
        front_x=front_x,
        front_y=front_y,
        rear_x=rear_x,
        rear_y=rear_y,
        speed=speed,
    )


def step(
    state: State,
    torque: Array,
    displacement: Array,
    pedal_force: Array,
    physics: Physics,
    speed_limits: tuple[float, float] | None = None,
    xp: ModuleType = np,
) -> State:
    """Simulate one time step of N bicycles.

    Args:
        state: bicycles before the step; not changed.
        torque: (N,) N m on the handlebar (T).
        displacement: (N,) m of the centre of mass, any noise already added (d).
        pedal_force: (N,) N on the pedal (F_1).
        physics: constants and corrections.
        speed_limits: bounds of the speed, m/s, or None (errata row 18).
        xp: numpy or torch.

    Returns:
        The bicycles dt later.
    """
    k = physics.constants
    dt = k.time_step
    speed = accelerate(state.speed, pedal_force, k, speed_limits, xp)
    curvature = curvatures(state.steer_angle, k, xp)
    lean_acceleration = lean_equation(state, displacement, speed, curvature, k, xp)
    steer_acceleration = steer_equation(state, torque, speed, physics)

    lean_rate = state.lean_rate + lean_acceleration * dt
    lean_angle = state.lean_angle + lean_rate * dt
    steer_rate = state.steer_rate + steer_acceleration * dt
    free_angle = state.steer_angle + steer_rate * dt
    steer_angle = xp.clip(free_angle, -k.steer_stop, k.steer_stop)
    if physics.stop_absorbs_steering:
        steer_rate = xp.where(free_angle == steer_angle, steer_rate, 0.0)

    moved = replace(
        state,
        lean_angle=lean_angle,
        lean_rate=lean_rate,
        lean_acceleration=lean_acceleration,
        steer_angle=steer_angle,
        steer_rate=steer_rate,
        speed=speed,
    )
    return _roll(moved, curvature, physics, xp)


def accelerate(
    speed: Array,
    pedal_force: Array,
    constants: Constants,
    speed_limits: tuple[float, float] | None = None,
    xp: ModuleType = np,
) -> Array:
    """Return the speed after dt of pedalling, m/s (eq. 11-13; updated first, row 18)."""
    acceleration = pedal_force * (constants.pedal_gain / constants.driven_mass)
    faster = speed + constants.time_step * acceleration
    return faster if speed_limits is None else xp.clip(faster, *speed_limits)


def curvatures(steer_angle: Array, constants: Constants, xp: ModuleType = np) -> Curvature:
    """Return 1/r_f, 1/r_b and 1/r_CM, 1/m, all finite at theta = 0 (eq. 3-4, rows 7, 11)."""
    wheelbase = constants.wheelbase
    sine, cosine = xp.abs(xp.sin(steer_angle)), xp.cos(steer_angle)
    front = sine / wheelbase
    rear = sine / (wheelbase * cosine)
    offset = (wheelbase - constants.front_to_mass) * rear
    return front, rear, rear / xp.sqrt(1.0 + offset * offset)


def lean_equation(
    state: State,
    displacement: Array,
    speed: Array,
    curvature: Curvature,
    constants: Constants,
    xp: ModuleType = np,
) -> Array:
    """Return the lean acceleration, rad/s^2 (omega double dot, eq. 5-6, rows 8-11)."""
    k = constants
    front, rear, mass = curvature
    tilt = state.lean_angle + xp.arctan(displacement / k.mass_height)
    wheel_rate = speed / k.tyre_radius
    tyres = k.tyre_mass * k.tyre_radius * (front + rear)
    turning = tyres + k.mass * k.mass_height * mass
    centrifugal = xp.sign(state.steer_angle) * speed * speed * turning
    gyroscopic = k.tyre_spin_inertia * wheel_rate * state.steer_rate
    gravity = k.mass * k.mass_height * k.gravity * xp.sin(tilt)
    return (gravity - xp.cos(tilt) * (gyroscopic + centrifugal)) / k.lean_inertia


def steer_equation(state: State, torque: Array, speed: Array, physics: Physics) -> Array:
    """Return steering acceleration, rad/s^2 (theta double dot, eq. 7, rows 12-13)."""
    k = physics.constants
    coupling = k.tyre_spin_inertia if physics.gyroscopic_correction else -k.tyre_lean_inertia
    wheel_rate = speed / k.tyre_radius
    return (torque + coupling * wheel_rate * state.lean_rate) / k.tyre_steer_inertia


def _roll(state: State, curvature: Curvature, physics: Physics, xp: ModuleType) -> State:
    """Move both contacts along their chords, restore the wheelbase, recompute the heading.

    Equations 1-2 and rows 3-6: the radii use the steering before the step, the angle of travel
    uses the steering after it.
    """
    k = physics.constants
    front_curvature, rear_curvature, _ = curvature
    travel = state.speed * k.time_step
    half_travel = 0.5 * travel
    pointing = state.heading + state.steer_angle
    if physics.chord_follows_steering:
        front_side = rear_side = xp.sign(state.steer_angle)
    else:
        front_side, rear_side = xp.sign(pointing), xp.sign(state.heading)
    front = pointing + front_side * _half_chord(half_travel, front_curvature, xp)
    rear = state.heading + rear_side * _half_chord(half_travel, rear_curvature, xp)
    front_x = state.front_x - travel * xp.sin(front)
    front_y = state.front_y + travel * xp.cos(front)
    rear_x = state.rear_x - travel * xp.sin(rear)
    rear_y = state.rear_y + travel * xp.cos(rear)

    along_x, along_y = rear_x - front_x, rear_y - front_y
    distance = xp.sqrt(along_x * along_x + along_y * along_y)
    drifted = xp.abs(distance - k.wheelbase) > k.wheelbase_tolerance
    stretch = xp.where(drifted, (k.wheelbase - distance) / distance, 0.0)
    rear_x = rear_x + along_x * stretch
    rear_y = rear_y + along_y * stretch
    return replace(
        state,
        heading=heading_between(rear_x, rear_y, front_x, front_y, xp),
        front_x=front_x,
        front_y=front_y,
        rear_x=rear_x,
        rear_y=rear_y,
    )


def _half_chord(half_travel: Array, curvature: Array, xp: ModuleType) -> Array:
    """Return half the angle of an arc of length 2 `half_travel`, at most pi/2 (eq. 1-2)."""
    return xp.arcsin(xp.clip(half_travel * curvature, -1.0, 1.0))


def fallen(lean_angle: Array, limit: float = FALL_ANGLE, xp: ModuleType = np) -> Array:
    """Return True if a bicycle has fallen: |omega| > `limit`, by default pi/6 (eq. 20, row 24)."""
    return xp.abs(lean_angle) > limit
