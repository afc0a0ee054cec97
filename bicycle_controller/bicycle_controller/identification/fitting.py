"""The fit: parameters that leave the least of a ride, with their covariance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from bicycle_controller.identification.logs import Array, Log
from bicycle_controller.identification.ride_model import OutputNoise, matrices, residuals, weave
from bicycle_controller.identification.ringdown import MeasuredMode
from bicycle_controller.identification.unknowns import Unknowns
from bicycle_controller.identification.windows import Stack
from bicycle_sim.plants.whipple.parameters import Parameters

STEP = 1e-4
"""Prior deviations over which derivatives are differenced."""


@dataclass(frozen=True)
class Fit:
    """A fitted bicycle."""

    unknowns: Unknowns
    x: Array
    """(k,) in prior deviations."""
    covariance: Array
    """(k, k) in prior deviations, the prior in it."""
    ride: Array
    """(k, k) information of the ride alone, in prior deviations."""
    misfit: tuple[float, float]
    """Rest of lean rate and steer angle, in units of their noise."""
    cost: float

    @property
    def parameters(self) -> Parameters:
        """Return the bicycle."""
        return self.unknowns.parameters(self.x)


def noise_of(logs: list[Log]) -> OutputNoise:
    """Return the outputs' noise: third differences, which a bicycle's own motion hardly has."""
    levels = []
    for key, least in (("lean_rate", 1e-3), ("steer_angle", 1e-4)):
        third = np.concatenate(
            [np.diff(getattr(piece, key), 3) for log in logs for piece in log.pieces]
        )
        first = np.concatenate(
            [np.abs(np.diff(getattr(piece, key))) for log in logs for piece in log.pieces]
        )
        some = first[first > 1e-9]
        quantum = float(np.quantile(some, 0.01)) if len(some) else 0.0
        white = 1.4826 * float(np.median(np.abs(third))) / np.sqrt(20.0)
        levels.append(max(least, white, quantum / np.sqrt(12.0)))
    return OutputNoise(*levels)


def fit(
    unknown: Unknowns,
    stacks: list[Stack],
    noise: OutputNoise,
    gains: Array | None = None,
    measured: list[tuple[MeasuredMode, float]] | None = None,
    start: Array | None = None,
    turns: int = 3,
) -> Fit:
    """Return the most probable bicycle.

    Args:
        unknown: the prior and what is free.
        stacks: windows of the ride.
        noise: of the outputs.
        gains: N m s/rad, by the windows' rows: the torque follows the lean rate; None for the
            logged torque.
        measured: modes that pushes showed, each with its law's gain; fitted beside the windows.
        start: (k,) of the search.
        turns: times that the weights are made anew.
    """
    count = sum(len(stack.rows) for stack in stacks)
    weights = np.ones(count)
    scale = np.ones(2)
    x = np.zeros(len(unknown.names)) if start is None else start.copy()

    def windows(x: Array) -> list[Array]:
        p = unknown.parameters(x)
        m = matrices(p)
        return [
            residuals(p, m, stack, noise, None if gains is None else gains[stack.rows])
            for stack in stacks
        ]

    def modes(x: Array) -> Array:
        if not measured:
            return np.zeros(0)
        p = unknown.parameters(x)
        m = matrices(p)
        rows = []
        for one, gain in measured:
            mode = weave(p, m, one.speed, gain)
            rows += [
                (mode.real - one.sigma) / one.sigma_error,
                (mode.imag - one.omega) / one.omega_error,
            ]
        return np.array(rows)

    def residual(x: Array) -> Array:
        rows = []
        for stack, left in zip(stacks, windows(x), strict=True):
            half = left.shape[1] // 2
            factor = weights[stack.rows, None]
            rows += [left[:, :half] * factor / scale[0], left[:, half:] * factor / scale[1]]
        return np.concatenate([*(row.ravel() for row in rows), modes(x), x])

    def jacobian(x: Array) -> Array:
        return _differences(residual, x)

    cost = 0.0
    for turn in range(turns):
        found = least_squares(residual, x, jac=jacobian, method="lm", max_nfev=12, xtol=1e-5)
        x, cost = found.x, float(found.cost)
        left = windows(x)
        scale, weights = _scales(stacks, left, count)
        if turn and found.nfev <= 2:
            break
    table = jacobian(x)
    ride = table[: -len(x)].T @ table[: -len(x)]
    inverse = np.linalg.inv(ride + np.eye(len(x)))
    scores = _scores(stacks, residual(x), table, len(modes(x)), count)
    covariance = inverse @ (scores.T @ scores + np.eye(len(x))) @ inverse
    return Fit(unknown, x, covariance, ride, (float(scale[0]), float(scale[1])), cost)


def _differences(function: Callable[[Array], Array], x: Array) -> Array:
    base = function(x)
    table = np.empty((len(base), len(x)))
    for column in range(len(x)):
        moved = x.copy()
        moved[column] += STEP
        table[:, column] = (function(moved) - base) / STEP
    return table


def _scales(stacks: list[Stack], left: list[Array], count: int) -> tuple[Array, Array]:
    """Return what is left of each output (at least the noise), and the weights of the windows."""
    power = np.zeros((count, 2))
    for stack, rest in zip(stacks, left, strict=True):
        half = rest.shape[1] // 2
        power[stack.rows, 0] = (rest[:, :half] ** 2).mean(axis=1)
        power[stack.rows, 1] = (rest[:, half:] ** 2).mean(axis=1)
    if not count:
        return np.ones(2), np.ones(0)
    scale = np.maximum(1.0, np.sqrt(np.median(power, axis=0)))
    size = np.sqrt((power / scale**2).mean(axis=1))
    return scale, 1.0 / np.sqrt(1.0 + (size / (3.0 * max(1.0, float(np.median(size))))) ** 2)


def _scores(stacks: list[Stack], rest: Array, table: Array, modes: int, count: int) -> Array:
    """Return (count + modes, k) gradients of the windows and of the modes."""
    scores = np.zeros((count + modes, table.shape[1]))
    place = 0
    for stack in stacks:
        for _ in range(2):
            size = stack.lean_rate.size
            part = rest[place : place + size, None] * table[place : place + size]
            scores[stack.rows] += part.reshape(len(stack.rows), -1, table.shape[1]).sum(axis=1)
            place += size
    rows = slice(place, place + modes)
    # A mode's standard error holds its own scatter; the fit's residual adds to it.
    scores[count:] = np.maximum(np.abs(rest[rows, None]), 1.0) * table[rows]
    return scores
