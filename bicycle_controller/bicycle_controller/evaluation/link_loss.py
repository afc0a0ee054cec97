"""Rides of N bicycles whose commands stop at a random moment.

The law of the microcontroller steers into the lean: kappa (6 - v) times the roll rate, less a
damping of the steering, from one gyro, the wheel and the steer encoder
(`bicycle_hardware/firmware/bicycle_core.c`). Beside it: the same without the damping, which a
motor that lags needs; the last torque held for 250 ms and then none, as the simulator's watchdog
does; and none at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from bicycle_controller.evaluation.sensing import FALL, Conditions
from bicycle_sim.plants.base import Loads, Plant

if TYPE_CHECKING:
    from bicycle_controller.control.controller import Controller

FIRMWARE, UNDAMPED = "steer into the lean", "roll rate alone"
HELD, NONE = "hold 250 ms, then zero", "zero"
LAWS = (FIRMWARE, UNDAMPED, HELD, NONE)
"""Reactions after the last command."""
GAIN, STABLE_SPEED = 10.0, 6.0
"""kappa, N m per rad/s and m/s; m/s. The firmware has the same (`CORE_DEFAULTS`)."""
DAMPING = 1.5
"""N m per rad/s of steer rate."""
STEER_STEP = 2.0 * math.pi / 8192
"""rad of the encoder whose differences are that rate."""
HOLD = 0.25
"""s."""
PERIOD = 0.01
"""s of the microcontroller's loop."""
AFTER = 10.0
"""s that are ridden after the loss."""
GYRO_NOISE, GYRO_BIAS = 0.01, 0.002
"""rad/s, standard deviations; the bias is what a calibration at rest leaves."""


@dataclass(frozen=True)
class Lost:
    """Results of the rides."""

    upright: np.ndarray
    """(N,) bool, AFTER s after the loss."""
    fall_time: np.ndarray
    """(N,) s from the loss to the fall; infinite where there was none."""
    speed: np.ndarray
    """(N,) m/s at the start."""

    @property
    def share(self) -> float:
        """Share of the rides that stay upright."""
        return float(self.upright.mean())


def fallback(
    roll_rate: np.ndarray,
    speed: np.ndarray,
    limit: float,
    steer_rate: np.ndarray,
    damping: float = DAMPING,
) -> np.ndarray:
    """Return the firmware's torque (N,), N m; rates (N,), rad/s, are positive to the left, too."""
    missing = np.clip(STABLE_SPEED - speed, 0.0, STABLE_SPEED)
    wanted = GAIN * missing * roll_rate - damping * steer_rate
    return np.where(missing > 0.0, np.clip(wanted, -limit, limit), 0.0)


def ride(
    controller: Controller,
    plant: Plant[Any],
    conditions: Conditions,
    law: str,
    count: int,
    seed: int,
) -> Lost:
    """Ride under a controller in gusts, lose it at a random moment, ride on under a law.

    Args:
        controller: sees the truth every 25 ms; without memory.
        plant: the bicycle; the conditions' motor and friction are put on it, not their delay.
        conditions: speeds, torque limit, motor, friction, gusts.
        law: one of LAWS.
        count: N rides, all upright when the commands stop.
        seed: not negative.

    Raises:
        ValueError: on another law, or if too few rides last until the commands stop.
    """
    if law not in LAWS:
        raise ValueError(f"no law {law!r}: choose one of {', '.join(LAWS)}")
    c = replace(conditions, delay=0.0)
    whole = c.applied(plant)
    quick = whole.with_time_step(PERIOD, substeps=4)
    rng = np.random.default_rng([seed, 17])
    zero = np.zeros(count)
    speed = rng.uniform(*c.speeds, count)
    lost_at = rng.integers(round(2.0 / PERIOD), round(6.0 / PERIOD), count)
    state = quick.initial(zero, zero, zero, speed)
    bias = GYRO_BIAS * rng.standard_normal(count)
    gust, torque, held, steer, steer_rate = zero, zero, zero, zero, zero
    fell = np.full(count, np.inf)
    most = c.torque_limit
    for step in range(int(lost_at.max()) + round(AFTER / PERIOD)):
        commanded = step < lost_at
        if step % round(whole.time_step / PERIOD + 0.5) == 0:
            o = (state.steer_angle, state.steer_rate, state.lean_angle, state.lean_rate)
            seen = np.array([*o, state.lean_acceleration, state.heading]).T
            torque = np.clip(controller.act(seen, state.speed)[:, 0], -most, most)
        held = np.where(commanded, torque, held)
        gyro = state.lean_rate + bias + GYRO_NOISE * rng.standard_normal(count)
        counted = STEER_STEP * np.rint(state.steer_angle / STEER_STEP)
        steer_rate, steer = 0.5 * (steer_rate + (counted - steer) / PERIOD), counted
        if law in (FIRMWARE, UNDAMPED):
            damping = DAMPING if law == FIRMWARE else 0.0
            alone = fallback(gyro, state.speed, most, steer_rate, damping)
        else:
            hold = HOLD if law == HELD else 0.0
            alone = np.where((step - lost_at) * PERIOD < hold, held, 0.0)
        keep = math.exp(-PERIOD)
        gust = keep * gust + c.wind * math.sqrt(1.0 - keep * keep) * rng.standard_normal(count)
        force = 0.5 * 1.2 * 0.5 * np.hypot(gust, state.speed) * gust
        state = quick.step(
            state,
            np.where(commanded, torque, alone),
            zero,
            zero,
            (speed - 0.1, speed + 0.1),
            Loads(lateral_force=force, force_height=1.0),
        )
        down = quick.fallen(state, FALL) & np.isinf(fell)
        fell[down] = step + 1
    kept = fell > lost_at
    if kept.mean() < 0.5:
        raise ValueError(
            f"only {kept.sum()} of {count} rides last until the commands stop: choose less wind, "
            "more torque or higher speeds"
        )
    after = (fell - lost_at) * PERIOD
    return Lost((after > AFTER)[kept], after[kept], speed[kept])
