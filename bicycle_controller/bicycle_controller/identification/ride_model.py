"""The linear bicycle as a fit simulates it: windows of a ride from any initial state.

Each window's initial state, a constant torque and an offset of the steering are nuisance
parameters: linear least squares inside each window solve for them, so that the fit has only the
bicycle's parameters (variable projection, Golub and Pereyra 1973).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm, toeplitz

from bicycle_controller.identification.logs import Array
from bicycle_controller.identification.windows import Stack
from bicycle_sim.plants.whipple import linear
from bicycle_sim.plants.whipple.linear import Matrices
from bicycle_sim.plants.whipple.parameters import Parameters

LEAN, STEER, LEAN_RATE, STEER_RATE = range(4)
LOOSE = (0.2, 0.5, 2.0, 8.0)
"""Prior standard deviations of a window's initial state; rad, rad, rad/s, rad/s."""
CONSTANT_TORQUE, STEER_OFFSET = 0.5, 0.03
"""N m and rad: standard deviations of a window's constants."""


class OutputNoise(NamedTuple):
    """Standard deviations of the two outputs."""

    lean_rate: float
    """rad/s."""
    steer_angle: float
    """rad."""


def system(p: Parameters, m: Matrices, speed: float) -> tuple[Array, Array]:
    """Return A (4, 4) and B (4,) of (lean, steer, their rates) under a steer torque."""
    inverse = np.linalg.inv(m.mass)
    damping = speed * m.damping
    damping[1, 1] += float(p.steering.damping)
    stiffness = float(p.bicycle.g) * m.weight + speed**2 * m.centrifugal
    a = np.zeros((4, 4))
    a[LEAN, LEAN_RATE] = a[STEER, STEER_RATE] = 1.0
    a[2:, :2], a[2:, 2:] = -inverse @ stiffness, -inverse @ damping
    b = np.zeros(4)
    b[2:] = inverse[:, 1]
    return a, b


def closed(p: Parameters, m: Matrices, speed: float, gain: float) -> Array:
    """Return the matrix under a torque of `gain` (N m s/rad) times the lean rate.

    The motor's lag is a state; the delay is one by its Padé approximation of first order.
    """
    a, b = system(p, m, speed)
    lag, delay = float(p.motor.lag), float(p.delay)
    size = 4 + (delay > 0.0) + (lag > 0.0)
    whole = np.zeros((size, size))
    whole[:4, :4] = a
    wanted = np.zeros(size)
    wanted[LEAN_RATE] = gain
    place = 4
    if delay > 0.0:
        # (1 - s T/2) / (1 + s T/2) = -1 + 2 / (1 + s T/2)
        whole[place] = wanted * 2.0 / delay
        whole[place, place] = -2.0 / delay
        wanted = -wanted
        wanted[place] = 2.0
        place += 1
    if lag > 0.0:
        whole[place] = wanted / lag
        whole[place, place] -= 1.0 / lag
        wanted = np.zeros(size)
        wanted[place] = 1.0
    whole[:4] += np.outer(b, wanted)
    return whole


def weave(p: Parameters, m: Matrices, speed: float, gain: float) -> complex:
    """Return the fastest oscillation (1/s) under a torque of `gain` times the lean rate."""
    found = np.linalg.eigvals(closed(p, m, speed, gain))
    return complex(found[found.imag.argmax()])


def delivered(p: Parameters, torque: Array, dt: float, count: int) -> Array:
    """Return (k, count) mean torques that the motor gives over each sample."""
    delay, lag = float(p.delay) / dt, float(p.motor.lag)
    whole, part = int(delay), delay - int(delay)
    padded = np.concatenate([np.repeat(torque[:, :1], whole + 1, axis=1), torque], axis=1)
    width = torque.shape[1]
    held = (1.0 - part) * padded[:, 1 : 1 + width] + part * padded[:, :width]
    if lag <= 1e-6:
        return held[:, -count:]
    keep = float(np.exp(-dt / lag))
    share = lag / dt * (1.0 - keep)
    state = held[:, 0].copy()
    given = np.empty_like(held)
    for column in range(width):
        given[:, column] = held[:, column] + (state - held[:, column]) * share
        state = held[:, column] + (state - held[:, column]) * keep
    return given[:, -count:]


def residuals(
    p: Parameters,
    m: Matrices,
    stack: Stack,
    noise: OutputNoise,
    gains: Array | None = None,
    known: int | None = None,
) -> Array:
    """Return what a model leaves of the windows of a stack, in units of the noise.

    Args:
        p: the bicycle.
        m: its matrices.
        stack: k windows of n samples.
        noise: of the outputs.
        gains: (k,) N m s/rad of a torque that follows the lean rate; None takes the torque
            as it was logged.
        known: samples that may be used for the initial state; all by default.

    Returns:
        (k, 2 n): lean rate, then steer angle.
    """
    if gains is None:
        return _rows(p, m, stack, noise, None, np.arange(len(stack.rows)), known)[0]
    found = np.empty((len(stack.rows), 2 * stack.lean_rate.shape[1]))
    for gain in np.unique(np.round(gains, 1)):
        rows = np.flatnonzero(np.round(gains, 1) == gain)
        found[rows] = _rows(p, m, stack, noise, float(gain), rows, known)[0]
    return found


def explained(p: Parameters, m: Matrices, stack: Stack, noise: OutputNoise) -> tuple[Array, Array]:
    """Return what `residuals` leaves under the logged torque, and what it solved for.

    Returns:
        (k, 2 n) in units of the noise; (k, 6) lean, steer and their rates at first, a constant
        torque, the steering's offset.
    """
    return _rows(p, m, stack, noise, None, np.arange(len(stack.rows)), None)


def _rows(
    p: Parameters,
    m: Matrices,
    stack: Stack,
    noise: OutputNoise,
    gain: float | None,
    rows: Array,
    known: int | None,
) -> tuple[Array, Array]:
    count = stack.lean_rate.shape[1]
    a, b = system(p, m, stack.speed)
    free = a if gain is None else closed(p, m, stack.speed, gain)
    size = len(free)
    both = np.zeros((size + 1, size + 1))
    both[:size, :size] = free
    both[:4, size] = b
    step = expm(both * stack.dt)
    # Columns: initial state, constant torque, offset of the steering.
    powers = _powers(step, count)
    table = np.zeros((2, count, size + 2))
    table[0, :, : size + 1] = powers[:, LEAN_RATE]
    table[1, :, : size + 1] = powers[:, STEER]
    impulse = np.diff(table[:, :, size], axis=1, prepend=0.0)
    table[1, :, size + 1] = 1.0
    y = np.stack([stack.lean_rate[rows], stack.steer_angle[rows]])
    if gain is None:
        torque = delivered(p, stack.torque[rows], stack.dt, count)
        for output in range(2):
            y[output] -= torque @ toeplitz(impulse[output], np.zeros(count)).T
    scale = np.array([noise.lean_rate, noise.steer_angle])[:, None]
    table = (table / scale[:, :, None]).reshape(2 * count, -1)
    y = np.concatenate([y[0] / scale[0], y[1] / scale[1]], axis=1)
    used = np.ones(2 * count, dtype=bool)
    if known is not None:
        used[known:count] = used[count + known :] = False
    loose = [*LOOSE, *[5.0] * (size - 4), CONSTANT_TORQUE, STEER_OFFSET]
    whole = np.vstack([table[used], np.diag(1.0 / np.array(loose))])
    target = np.concatenate([y[:, used], np.zeros((len(rows), size + 2))], axis=1)
    q, r = np.linalg.qr(whole)
    solution = np.linalg.solve(r, q.T @ target.T)
    rest: Array = y - (table @ solution).T
    return rest, solution.T


def _powers(step: Array, count: int) -> Array:
    """Return (count, n, n), the powers 0, 1, ... of a matrix (n, n)."""
    found = np.eye(len(step))[None]
    last = step
    while len(found) < count:
        found = np.concatenate([found, found @ last])
        last = last @ last
    return found[:count]


def matrices(p: Parameters) -> Matrices:
    """Return M, C1, K0, K2."""
    return linear.matrices(p.bicycle)
