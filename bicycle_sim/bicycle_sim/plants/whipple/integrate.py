"""One control period of Whipple bicycles: actuators, friction, stops and Runge-Kutta's 4th order.

This is the reference of `whipple.cpp`, which has the same operations in the same order and gives
the same bits; it serves where that was not built.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import ModuleType, SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from bicycle_sim.plants.base import Array
from bicycle_sim.plants.whipple.constants import UNLIMITED, Constants
from bicycle_sim.plants.whipple.equations import Forces, motion
from bicycle_sim.plants.whipple.kinematics import Pose, Rolling, front_contact, rolling
from bicycle_sim.plants.whipple.trigonometry import sine_cosine, sine_cosine_of_turn

LIES = 1.3
"""rad of lean at which a bicycle lies and moves no more, whatever its controller is asked."""

MOVING = (
    "lean_angle",
    "lean_rate",
    "steer_angle",
    "steer_rate",
    "heading",
    "rear_x",
    "rear_y",
    "speed",
    "pitch",
    "rear_wheel_angle",
    "front_wheel_angle",
    "rider_lean",
    "rider_rate",
)
"""Rows that Runge-Kutta integrates."""

ROWS = (*MOVING, "motor_torque", "stopped", "front_x", "front_y", "yaw_rate")
"""Rows that `advance` takes and returns, in the order of `whipple.cpp`."""


class Inputs(NamedTuple):
    """Inputs of one control period, each a float or (N,), in the order of `whipple.cpp`.

    `_before` is the command of the period before, which rules for the share `delay_share`.
    """

    torque_before: Array
    torque: Array
    pedal_before: Array
    pedal: Array
    displacement_before: Array
    displacement: Array
    speed_low: Array
    speed_high: Array
    force_across: Array
    """N across the rear wheel's plane, at its centre; the torques about its x and z follow."""
    torque_x: Array
    torque_z: Array
    wind_x: Array
    wind_y: Array


FLOATS: Any = SimpleNamespace(
    sqrt=math.sqrt, where=lambda mask, first, second: first if mask else second
)
"""Substitute for numpy if one bicycle is plain floats, ten times as fast."""


def _bounded(value: Array, low: Array, high: Array, xp: ModuleType) -> Array:
    """Return `value` clipped to two bounds."""
    value = xp.where(value < low, low, value)
    return xp.where(value > high, high, value)


def advance(
    k: Constants,
    state: Mapping[str, Array],
    u: Inputs,
    substeps: int,
    time_step: float,
    first: int,
    last: int,
    extras: bool,
    leaning_rider: bool,
    xp: ModuleType = np,
) -> dict[str, Array]:
    """Integrate the substeps `first` to `last` (not included) of a control period.

    Args:
        k: of the bicycles.
        state: ROWS, each a float or (N,).
        u: what acts.
        substeps: of a whole control period.
        time_step: s of a whole control period.
        first: of the substeps to make.
        last: the one that is not made.
        extras: True if there are air, road, rolling resistance or loads.
        leaning_rider: True if there is a rider who leans.
        xp: numpy, torch or FLOATS.

    Returns:
        ROWS afterwards.
    """
    h = time_step / substeps
    now = dict(state)
    for index in range(first, last):
        now = _substep(k, now, u, index, substeps, h, extras, leaning_rider, xp)
    r = rolling(k, now["lean_angle"], now["pitch"], now["steer_angle"], xp)
    forward, across = front_contact(k, r)
    sine, cosine = sine_cosine_of_turn(now["heading"])
    now["front_x"] = now["rear_x"] - (sine * forward + cosine * across)
    now["front_y"] = now["rear_y"] + (cosine * forward - sine * across)
    turning = r.yaw[0] * now["lean_rate"] + r.yaw[1] * now["steer_rate"]
    now["yaw_rate"] = turning + r.yaw[2] * now["speed"]
    return now


def _substep(
    k: Constants,
    now: dict[str, Array],
    u: Inputs,
    index: int,
    substeps: int,
    h: float,
    extras: bool,
    leaning_rider: bool,
    xp: ModuleType,
) -> dict[str, Array]:
    """Make one step of integration, h seconds long."""
    # Commands: how much of each half the older one rules.
    early = _bounded(k.delay_share * (2.0 * substeps) - 2.0 * index, 0.0, 1.0, xp)
    late = _bounded(k.delay_share * (2.0 * substeps) - (2.0 * index + 1.0), 0.0, 1.0, xp)
    older = 0.5 * (early + late)
    begun = now["motor_torque"]
    middle = _motor(k, begun, early * u.torque_before + (1.0 - early) * u.torque, xp)
    ended = _motor(k, middle, late * u.torque_before + (1.0 - late) * u.torque, xp)
    mean = 0.5 * (middle + ended)
    instant = k.motor_instant > 0.5
    torques = tuple(xp.where(instant, mean, torque) for torque in (begun, middle, ended))
    commands = _Commands(
        pedal=k.gear * (older * u.pedal_before + (1.0 - older) * u.pedal),
        displacement=older * u.displacement_before + (1.0 - older) * u.displacement,
    )

    # The classical Runge-Kutta method.
    stage = dict(now)
    total: dict[str, Array] = {}
    grip: _Grip | None = None
    rideable: Array = True
    for number, (torque, ahead) in enumerate(
        zip(
            (torques[0], torques[1], torques[1], torques[2]),
            (0.5 * h, 0.5 * h, h, 0.0),
            strict=True,
        )
    ):
        r = rolling(k, stage["lean_angle"], stage["pitch"], stage["steer_angle"], xp)
        slopes, give = _slopes(k, stage, u, torque, commands, r, extras, leaning_rider, xp)
        if grip is None:
            grip = _grip(k, now, slopes["steer_rate"], give[1], h, xp)
            rideable = _rideable(k, now, r)
        _held(slopes, give, grip, leaning_rider, xp)
        for name, slope in slopes.items():
            if number == 0:
                total[name] = slope
            elif number == 3:
                total[name] = total[name] + slope
            else:
                total[name] = total[name] + 2.0 * slope
            if number < 3:
                stage[name] = now[name] + ahead * slope

    assert grip is not None
    moved = dict(now)
    for name, slope in total.items():
        moved[name] = now[name] + (h / 6.0) * slope
    moved["motor_torque"] = ended
    moved["steer_rate"] = xp.where(grip.rests, 0.0, moved["steer_rate"])
    moved["steer_angle"] = _bounded(moved["steer_angle"], -k.stop, k.stop, xp)
    heading = moved["heading"]
    heading = xp.where(heading > math.pi, heading - 2.0 * math.pi, heading)
    moved["heading"] = xp.where(heading <= -math.pi, heading + 2.0 * math.pi, heading)
    sane = (
        (abs(moved["lean_rate"]) < 100.0)
        & (abs(moved["steer_rate"]) < 1000.0)
        & (abs(moved["speed"]) < 100.0)
    )
    goes_on = rideable & sane
    after = {name: xp.where(goes_on, moved[name], now[name]) for name in now}
    after["stopped"] = xp.where(goes_on, now["stopped"], 1.0)
    return after


class _Commands(NamedTuple):
    pedal: Array
    """N at the rim."""
    displacement: Array
    """m."""


def _motor(k: Constants, torque: Array, wanted: Array, xp: ModuleType) -> Array:
    """Return the motor's torque half a substep later, N m: dead band, limit, lag and rate."""
    target = wanted - _bounded(wanted, -k.motor_dead, k.motor_dead, xp)
    target = _bounded(target, -k.motor_limit, k.motor_limit, xp)
    change = _bounded(k.motor_share * (target - torque), -k.motor_change, k.motor_change, xp)
    return xp.where(k.motor_instant > 0.5, target, torque + change)


def _rim_force(k: Constants, u: Inputs, pedal: Array, speed: Array, xp: ModuleType) -> Array:
    """N at the rear wheel's rim: pedal and governor within power and brake."""
    slow, fast = u.speed_low - speed, speed - u.speed_high
    wanted = pedal + k.governor * xp.where(slow > 0.0, slow, 0.0)
    wanted = wanted - k.governor * xp.where(fast > 0.0, fast, 0.0)
    most = k.power / xp.where(speed < 1.0, 1.0, speed)
    wanted = _bounded(wanted, -k.brake, most, xp)
    return xp.where(wanted < 0.0, wanted * _fade(speed, xp), wanted)


def _fade(speed: Array, xp: ModuleType) -> Array:
    """Return the factor of a force against the motion that makes it end at rest."""
    return _bounded(10.0 * speed, -1.0, 1.0, xp)


def _rider_torque(
    k: Constants, stage: Mapping[str, Array], displacement: Array, r: Rolling, xp: ModuleType
) -> Array:
    """N m with which the rider's muscle and body act between rider and rear frame."""
    lean, rate = stage["rider_lean"], stage["rider_rate"]
    sine, cosine = sine_cosine(lean)
    wanted = _bounded(k.muscle_gain * displacement, -0.7, 0.7, xp)
    muscle = k.muscle_stiffness * (wanted - sine) - k.muscle_damping * rate
    muscle = muscle - k.muscle_weight * (r.sine[0] * cosine + r.cosine[0] * sine)
    muscle = _bounded(muscle, -k.muscle_limit, k.muscle_limit, xp)
    return muscle - (k.passive_stiffness * lean + k.passive_damping * rate)


def _outside(
    k: Constants, stage: Mapping[str, Array], u: Inputs, r: Rolling, xp: ModuleType
) -> dict[str, Any]:
    """Air, road and loads, as arguments of `Forces`."""
    sine, cosine = sine_cosine_of_turn(stage["heading"])
    speed = stage["speed"]
    along = (u.wind_y * cosine - u.wind_x * sine) - speed
    side = -(u.wind_x * cosine + u.wind_y * sine)
    push, shove = k.drag * (along * abs(along)), k.side_drag * (side * abs(side))
    across, below = shove * r.cosine[0], -(shove * r.sine[0])
    fade = _fade(speed, xp)
    return {
        "road_forward": k.gravity_y * cosine - k.gravity_x * sine,
        "road_across": -(k.gravity_x * cosine + k.gravity_y * sine),
        "force": (push, across + u.force_across, below),
        "torque": (
            u.torque_x - k.pressure_down * across,
            k.pressure_down * push - k.pressure_forward * below,
            u.torque_z + k.pressure_forward * across,
        ),
        "rear_rolling": k.rear_rolling * fade,
        "front_rolling": k.front_rolling * fade,
    }


def _slopes(
    k: Constants,
    stage: Mapping[str, Array],
    u: Inputs,
    torque: Array,
    commands: _Commands,
    r: Rolling,
    extras: bool,
    leaning_rider: bool,
    xp: ModuleType,
) -> tuple[dict[str, Array], tuple[Array, Array, Array, Array]]:
    """Return rates of change, and those of the free speeds per N m of steer torque."""
    speed = stage["speed"]
    forces = Forces(
        steer_torque=torque - k.damping * stage["steer_rate"],
        rim_force=_rim_force(k, u, commands.pedal, speed, xp),
        **(_outside(k, stage, u, r, xp) if extras else {}),
        rider_torque=(
            _rider_torque(k, stage, commands.displacement, r, xp) if leaning_rider else 0.0
        ),
    )
    pose = Pose(
        stage["lean_angle"],
        stage["pitch"],
        stage["steer_angle"],
        stage["lean_rate"],
        stage["steer_rate"],
        speed,
        stage["rider_lean"],
        stage["rider_rate"],
    )
    m = motion(k, pose, forces, r, extras, leaning_rider)
    sine, cosine = sine_cosine_of_turn(stage["heading"])
    slopes = {
        "lean_angle": stage["lean_rate"],
        "lean_rate": m.lean,
        "steer_angle": stage["steer_rate"],
        "steer_rate": m.steer,
        "heading": m.yaw_rate,
        "rear_x": -(speed * sine),
        "rear_y": speed * cosine,
        "speed": m.speed,
        "pitch": m.pitch_rate,
        "rear_wheel_angle": speed * k.rear_curvature + m.pitch_rate,
        "front_wheel_angle": m.front_spin * k.front_curvature,
    }
    if leaning_rider:
        slopes["rider_lean"], slopes["rider_rate"] = stage["rider_rate"], m.rider
    return slopes, m.give


class _Grip(NamedTuple):
    """Effect of friction and stop on the steering during one substep."""

    sticks: Array
    """It rests and stays at rest."""
    rests: Array
    """It is at rest at the end."""
    torque: Array
    """N m, where it does not stick."""


def _grip(
    k: Constants, now: Mapping[str, Array], steer_up: Array, give: Array, h: float, xp: ModuleType
) -> _Grip:
    """Friction that would bring the steering to rest in this substep, or the most there is.

    This is the time-stepping of Coulomb's law: no velocity is taken for zero that is not, and
    what rests is held by any torque up to the stiction. A stop is friction without a limit, in
    the direction away from it.
    """
    needed = -(now["steer_rate"] / h + steer_up) / give
    resting = now["steer_rate"] == 0.0
    strength = xp.where(resting, k.stiction, k.friction)
    at_left, at_right = now["steer_angle"] >= k.stop, now["steer_angle"] <= -k.stop
    low = xp.where(at_left, -UNLIMITED, -strength)
    high = xp.where(at_right, UNLIMITED, strength)
    holds = (needed >= low) & (needed <= high) & (low < high)
    slides = _bounded(
        needed,
        xp.where(at_left, -UNLIMITED, -k.friction),
        xp.where(at_right, UNLIMITED, k.friction),
        xp,
    )
    return _Grip(holds & resting, holds, xp.where(holds, needed, slides))


def _held(
    slopes: dict[str, Array],
    give: tuple[Array, Array, Array, Array],
    grip: _Grip,
    leaning_rider: bool,
    xp: ModuleType,
) -> None:
    """Put the torque of friction and stop into the slopes."""
    steer_up = slopes["steer_rate"]
    torque = xp.where(grip.sticks, -(steer_up / give[1]), grip.torque)
    slopes["lean_rate"] = slopes["lean_rate"] + give[0] * torque
    moved = steer_up + give[1] * torque
    slopes["steer_rate"] = xp.where(grip.sticks, 0.0, moved)
    slopes["speed"] = slopes["speed"] + give[2] * torque
    if leaning_rider:
        slopes["rider_rate"] = slopes["rider_rate"] + give[3] * torque


def _rideable(k: Constants, now: Mapping[str, Array], r: Rolling) -> Array:
    """Return True if the bicycle stands and its geometry is far from singular."""
    return (
        (now["stopped"] == 0.0)
        & (abs(now["lean_angle"]) < LIES)
        & (r.yaw_lever > k.turn_limit)
        & (r.pitch_lever < -k.turn_limit)
    )
