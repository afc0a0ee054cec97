"""Modes as a ride shows them: an exponential sine through the lean rate after each push."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from bicycle_controller.identification.logs import Array, Log
from bicycle_controller.identification.pushes import pushes, released

SECONDS = 1.0
"""s of lean rate that are fitted."""
GOOD = 0.98
"""Share of the variance that a fit must explain to count."""

ALIKE = 0.4
"""m/s within which pushes are taken together."""
ENOUGH = 3
"""Pushes that make a mode."""


class Ringdown(NamedTuple):
    """Mode that one push showed."""

    piece: int
    start: int
    speed: float
    """m/s."""
    sigma: float
    """1/s, real part."""
    omega: float
    """rad/s."""
    explained: float


class MeasuredMode(NamedTuple):
    """The mode of one log: medians over its pushes with standard errors."""

    log: str
    speed: float
    sigma: float
    sigma_error: float
    omega: float
    omega_error: float
    pushes: int


def exponential_sine(rate: Array, dt: float) -> tuple[float, float, float]:
    """Return (1/s, rad/s, explained share) of exp(s t) (a cos w t + b sin w t) + c, (n,)."""
    t = np.arange(len(rate)) * dt

    def fitted(p: Array) -> Array:
        envelope = np.exp(np.clip(p[0] * t, -50.0, 50.0))
        table = np.stack(
            [envelope * np.cos(p[1] * t), envelope * np.sin(p[1] * t), np.ones_like(t)], axis=1
        )
        answer: Array = table @ np.linalg.lstsq(table, rate, rcond=None)[0]
        return answer

    found = least_squares(lambda p: fitted(p) - rate, [-2.0, 7.5], max_nfev=60)
    rest = 2.0 * float(found.cost) / max(float(((rate - rate.mean()) ** 2).sum()), 1e-12)
    return float(found.x[0]), abs(float(found.x[1])), 1.0 - rest


def ringdowns(log: Log) -> list[Ringdown]:
    """Return the pushes of a log whose lean rate afterwards is an exponential sine."""
    found = []
    for number, piece in enumerate(log.pieces):
        count = round(SECONDS / piece.dt)
        events = pushes(piece)
        for index, (first, last) in enumerate(events):
            start = released(piece, first, last)
            following = events[index + 1][0] if index + 1 < len(events) else len(piece.speed)
            if start + count > min(following, len(piece.speed)):
                continue
            sigma, omega, explained = exponential_sine(
                piece.lean_rate[start : start + count], piece.dt
            )
            if explained >= GOOD and -15.0 < sigma < 2.0 and 1.0 < omega < 40.0:
                speed = float(piece.speed[start : start + count].mean())
                found.append(Ringdown(number, start, speed, sigma, omega, explained))
    return found


def summary(log: Log, found: list[Ringdown]) -> list[MeasuredMode]:
    """Return the mode of a log at each speed at which three pushes or more show it."""
    order = sorted(found, key=lambda one: one.speed)
    groups: list[list[Ringdown]] = []
    for one in order:
        if groups and one.speed - groups[-1][0].speed <= ALIKE:
            groups[-1].append(one)
        else:
            groups.append([one])
    return [_mean(log, group) for group in groups if len(group) >= ENOUGH]


def _mean(log: Log, found: list[Ringdown]) -> MeasuredMode:
    sigma, omega = (np.array([getattr(one, key) for one in found]) for key in ("sigma", "omega"))

    def error(values: Array, least: float) -> float:
        spread = 1.4826 * float(np.median(np.abs(values - np.median(values))))
        return max(1.25 * spread / float(np.sqrt(len(values))), least)

    return MeasuredMode(
        log.name,
        float(np.mean([one.speed for one in found])),
        float(np.median(sigma)),
        error(sigma, 0.03),
        float(np.median(omega)),
        error(omega, 0.01 * float(np.median(omega))),
        len(found),
    )
