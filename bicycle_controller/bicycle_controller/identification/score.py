"""Score of a bicycle that foretells a ride: its lean rate half a second ahead."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm, solve_discrete_are

from bicycle_controller.identification.logs import Array, Log, Piece
from bicycle_controller.identification.pushes import pushed, pushes, released
from bicycle_controller.identification.ride_model import (
    LEAN_RATE,
    STEER,
    OutputNoise,
    closed,
    delivered,
    matrices,
    system,
)
from bicycle_controller.identification.windows import SLOWEST
from bicycle_sim.plants.whipple.linear import Matrices
from bicycle_sim.plants.whipple.parameters import Parameters

AHEAD = 0.5
"""Time of a prediction, s."""
UNKNOWN = (2.0, 6.0)
"""rad/s^2 per square root of Hz: accelerations of lean and steering that no model knows."""


class PredictionScore(NamedTuple):
    """Score of predictions over a log, or over several."""

    explained: float
    """Share of the lean rate's variance that was foretold; 1 is all."""
    error: float
    """rad/s, root mean square."""
    predictions: int
    """Number of predictions; each spans AHEAD without a push."""


def ahead(
    p: Parameters,
    logs: list[Log],
    noise: OutputNoise,
    laws: list[tuple[float, float] | None],
    since: float = 0.0,
) -> tuple[PredictionScore, PredictionScore]:
    """Return the scores of predictions of the lean rate AHEAD from what was seen before.

    The present state is a Kalman filter's, of the same bicycle. No prediction spans a push.

    Args:
        p: the bicycle.
        logs: the rides.
        noise: of the outputs.
        laws: of each log, (a, b) if the torque is (a + b v) times the lean rate, which is then
            foretold, too; None takes the torque as it was logged.
        since: the share of each piece before which nothing is judged.

    Returns:
        Of the lean rate AHEAD of every moment; of the lean rates from the moment when a push lets
        go until AHEAD later.
    """
    ends: list[tuple[Array, Array]] = []
    paths: list[tuple[Array, Array]] = []
    for log, law in zip(logs, laws, strict=True):
        for piece in log.pieces:
            count = round(AHEAD / piece.dt)
            if len(piece.speed) < 4 * count:
                continue
            foretold = _foretold(p, piece, noise, law)
            bad = pushed(piece, 0.02) | (piece.speed < SLOWEST)
            total = np.concatenate([[0], np.cumsum(bad)])
            begin = max(round(1.0 / piece.dt), int(since * len(bad)))
            rows = np.arange(begin, len(bad) - count)
            free = rows[total[rows + count] == total[rows]]
            ends.append((piece.lean_rate[free + count], foretold[free, -1]))
            for first, last in pushes(piece):
                start = released(piece, first, last)
                if begin <= start < len(bad) - count and piece.speed[start] > SLOWEST:
                    rows = np.arange(start + 1, start + count + 1)
                    paths.append((piece.lean_rate[rows], foretold[start]))
    return _score(ends), _score(paths)


def _score(parts: list[tuple[Array, Array]]) -> PredictionScore:
    if sum(len(wanted) for wanted, _ in parts) < 2:
        return PredictionScore(float("nan"), float("nan"), 0)
    wanted, guess = (np.concatenate(side) for side in zip(*parts, strict=True))
    error = np.clip(guess - wanted, -1e3, 1e3)
    variance = float(((wanted - wanted.mean()) ** 2).sum())
    explained = 1.0 - float((error**2).sum()) / max(variance, 1e-12)
    return PredictionScore(explained, float(np.sqrt((error**2).mean())), len(wanted))


def _foretold(
    p: Parameters, piece: Piece, noise: OutputNoise, law: tuple[float, float] | None
) -> Array:
    """Return (n - count, count) lean rates foretold at each sample for the next ones."""
    count, dt = round(AHEAD / piece.dt), piece.dt
    torque = delivered(p, piece.torque[None], dt, len(piece.torque))[0]
    m = matrices(p)
    speeds = np.maximum(np.round(piece.speed, 1), 0.1)
    tools = {speed: _tools(p, m, speed, dt, noise) for speed in np.unique(speeds)}
    x = np.zeros(6)
    y = np.stack([piece.lean_rate, piece.steer_angle], axis=1)
    states = np.empty((len(torque), 6))
    for sample in range(len(torque)):
        step, push, gain = tools[speeds[sample]]
        x = x + gain @ (y[sample] - (x[LEAN_RATE], x[STEER] + x[5]))
        states[sample] = x
        x = step @ x + push * torque[sample]
    guess = np.empty((len(torque) - count, count))
    for speed, (step, push, _) in tools.items():
        rows = np.flatnonzero(speeds[: len(guess)] == speed)
        now = states[rows]
        if law is not None:
            whole = closed(p, m, speed, law[0] + law[1] * speed)
            both = np.zeros((len(whole) + 1, len(whole) + 1))
            both[:-1, :-1], both[:4, -1] = whole, system(p, m, speed)[1]
            step = expm(both * dt)
            now = np.zeros((len(rows), len(both)))
            now[:, :4], now[:, -1] = states[rows, :4], states[rows, 4]
        for later in range(count):
            now = now @ step.T
            if law is None:
                now += np.outer(torque[rows + later], push)
            guess[rows, later] = now[:, LEAN_RATE]
    return guess


def _tools(
    p: Parameters, m: Matrices, speed: float, dt: float, noise: OutputNoise
) -> tuple[Array, Array, Array]:
    """Return the step (6, 6), the torque's part (6,) and the filter's gain (6, 2).

    States: lean, steer, their rates, a constant torque and the steering's offset.
    """
    a, b = system(p, m, speed)
    both = np.zeros((7, 7))
    both[:4, :4] = a
    both[:4, 4] = both[:4, 6] = b
    # Both constants fade, at two rates: together with the lean they could not be told apart.
    both[4, 4], both[5, 5] = -0.5, -0.05
    step = expm(both * dt)
    drift = np.array([0.003, 0.0, *UNKNOWN, 0.2, 0.002]) ** 2 * dt
    seen = np.zeros((2, 6))
    seen[0, LEAN_RATE] = seen[1, STEER] = seen[1, 5] = 1.0
    spread = np.diag([noise.lean_rate**2, max(noise.steer_angle, 5e-4) ** 2])
    one = step[:6, :6]
    found = solve_discrete_are(one.T, seen.T, np.diag(drift + 1e-10), spread)
    gain = found @ seen.T @ np.linalg.inv(seen @ found @ seen.T + spread)
    return one, step[:6, 6], gain


def law_of(log: Log) -> tuple[float, float, float]:
    """Return (a, b, share): the torque as (a + b v) times the lean rate, and what that explains.

    b is zero where the speed hardly changes.
    """
    rows = [np.concatenate([getattr(piece, key) for piece in log.pieces]) for key in KEYS]
    rate, torque, speed = rows
    ridden = speed > 0.5
    rate, torque, speed = rate[ridden], torque[ridden], speed[ridden]
    if len(rate) < 10 or float(np.std(torque)) < 1e-9:
        return 0.0, 0.0, 0.0
    columns = [rate] + ([rate * speed] if float(np.std(speed)) > 0.03 else [])
    table: Array = np.stack(columns, axis=1)
    good = np.ones(len(rate), dtype=bool)
    answer = np.zeros(len(columns))
    for _ in range(3):
        answer = np.linalg.lstsq(table[good], torque[good], rcond=None)[0]
        rest = np.abs(torque - table @ answer)
        good = rest <= max(float(np.quantile(rest, 0.9)), 1e-9)
    rest = (torque - table @ answer)[good]
    share = 1.0 - float((rest**2).sum() / max((torque[good] ** 2).sum(), 1e-12))
    return float(answer[0]), float(answer[1]) if len(columns) > 1 else 0.0, share


KEYS = ("lean_rate", "torque", "speed")
