"""Pushes in a ride: stretches in which the lean accelerates as no bicycle does by itself."""

from __future__ import annotations

import numpy as np

from bicycle_controller.identification.logs import Array, Piece

HALF = 0.03
"""s to either side over which accelerations are differenced."""
TOGETHER = 0.09
"""s over which an acceleration must be unexplained."""
UNUSUAL = 3.0
"""Number of robust standard deviations above which an acceleration is unexplained."""
APART = 0.25
"""s; pushes nearer to each other are one."""
STRONGEST = 0.15
"""rad/s of lean rate that a push must reach to be one."""


def pushes(piece: Piece) -> list[tuple[int, int]]:
    """Return first and last sample of each push, after a robust regression of the acceleration."""
    half = max(1, round(HALF / piece.dt))
    width = max(1, round(TOGETHER / piece.dt))
    count = len(piece.speed)
    if count < 40 * half:
        return []
    smooth = np.ones(2 * half) / (2 * half)
    rate = piece.lean_rate
    acceleration = np.zeros(count)
    acceleration[half:-half] = (rate[2 * half :] - rate[: -2 * half]) / (2 * half * piece.dt)
    turning = np.gradient(piece.steer_angle) / piece.dt
    signals = (piece.steer_angle, turning, rate, piece.torque, np.cumsum(rate) * piece.dt)
    table = np.stack([np.convolve(s, smooth, "same") for s in signals] + [np.ones(count)], axis=1)
    weights = np.ones(count)
    rest = acceleration
    spread = 0.0
    for _ in range(15):
        solution = np.linalg.lstsq(table * weights[:, None], acceleration * weights, rcond=None)[0]
        rest = acceleration - table @ solution
        spread = 1.4826 * float(np.median(np.abs(rest))) + 1e-9
        weights = 1.0 / (1.0 + (rest / (2.0 * spread)) ** 2)
    hot = np.abs(np.convolve(rest, np.ones(width) / width, "same")) > UNUSUAL * spread
    found: list[tuple[int, int]] = []
    for index in np.flatnonzero(hot):
        if found and index - found[-1][1] <= APART / piece.dt:
            found[-1] = (found[-1][0], int(index))
        else:
            found.append((int(index), int(index)))
    return [
        (first, last)
        for first, last in found
        if np.abs(rate[first : last + width]).max() > STRONGEST
    ]


def released(piece: Piece, first: int, last: int) -> int:
    """Return the sample at which a push lets go: the largest lean rate in and just after it."""
    after = round(0.1 / piece.dt)
    return first + int(np.abs(piece.lean_rate[first : last + after]).argmax())


def pushed(piece: Piece, margin: float = 0.06) -> Array:
    """Return bool (n,), True during pushes and `margin` s around them."""
    mask = np.zeros(len(piece.speed), dtype=bool)
    around = round(margin / piece.dt)
    for first, last in pushes(piece):
        mask[max(0, first - around) : last + around + 1] = True
    return mask
