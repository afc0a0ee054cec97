"""Rides with large angles, less the difference between the nonlinear and the linear bicycle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bicycle_controller.identification.logs import Array
from bicycle_controller.identification.ride_model import (
    OutputNoise,
    delivered,
    explained,
    matrices,
)
from bicycle_controller.identification.windows import Stack
from bicycle_sim.plants.whipple.parameters import Motor, Parameters
from bicycle_sim.plants.whipple.plant import WhipplePlant

FINEST = 0.0125
"""s of a step of integration."""
MOST = (0.5, 0.3)
"""rad/s and rad; windows with a larger difference stay as they are."""


def straightened(p: Parameters, stacks: list[Stack], noise: OutputNoise) -> list[Stack]:
    """Return the windows as a linear bicycle would have ridden them.

    From a window's initial state and torque both bicycles are simulated; their difference is taken
    off what was measured. Coulomb friction of the bicycle's file is part of it.

    Args:
        p: the bicycle, as well as it is known.
        stacks: windows as measured.
        noise: of the outputs.
    """
    m = matrices(p)
    found = []
    for stack in stacks:
        count = stack.lean_rate.shape[1]
        rest, solved = explained(p, m, stack, noise)
        torque = delivered(p, stack.torque, stack.dt, count) + solved[:, 4:5]
        rate, angle = _ridden(p, stack, solved, torque)
        linear_rate = stack.lean_rate - rest[:, :count] * noise.lean_rate
        linear_angle = stack.steer_angle - rest[:, count:] * noise.steer_angle
        more_rate, more_angle = rate - linear_rate, angle + solved[:, 5:6] - linear_angle
        small = (np.abs(more_rate) < MOST[0]) & (np.abs(more_angle) < MOST[1])
        use = small.all(axis=1)[:, None]
        found.append(
            stack._replace(
                lean_rate=stack.lean_rate - np.where(use, more_rate, 0.0),
                steer_angle=stack.steer_angle - np.where(use, more_angle, 0.0),
            )
        )
    return found


def _ridden(p: Parameters, stack: Stack, solved: Array, torque: Array) -> tuple[Array, Array]:
    """Return lean rate and steer angle (k, n) of the nonlinear bicycle at a constant speed."""
    windows, count = torque.shape
    plant = WhipplePlant(
        replace(
            p,
            motor=Motor(),
            delay=0.0,
            time_step=stack.dt,
            substeps=max(1, int(np.ceil(stack.dt / FINEST))),
        )
    )
    zero = np.zeros(windows)
    speed = np.full(windows, stack.speed)
    state = plant.initial(zero, zero, zero, speed)
    state.lean_angle, state.steer_angle, state.lean_rate, state.steer_rate = (
        np.ascontiguousarray(np.clip(solved[:, column], -limit, limit))
        for column, limit in enumerate((0.7, 0.7, 5.0, 20.0))
    )
    state = plant.settled(state)
    rate, angle = np.empty((windows, count)), np.empty((windows, count))
    for sample in range(count):
        rate[:, sample], angle[:, sample] = state.lean_rate, state.steer_angle
        given = np.ascontiguousarray(torque[:, sample])
        state = plant.step(state, given, zero, zero, (speed, speed))
    return rate, angle
