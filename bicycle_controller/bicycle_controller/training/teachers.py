"""An LQR for each of thousands of bicycles at once, which knows its delay and its motor's lag.

What `control.lqr` does for one bicycle, with the steady turns of the linear model: a heading loop
wants a turn, and a linear regulator rides it. The regulator sees everything, the motor's torque
and the commands under way too. It is a teacher: an actor that sees less imitates it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from bicycle_controller.config.imitation import TeacherWeights, TurnConfig
from bicycle_controller.control.lqr import TURN_ERRORS
from bicycle_controller.control.past import parameters_of
from bicycle_sim.plants.base import Plant

STATES = ("lean_angle", "lean_rate", "steer_angle", "steer_rate")
"""States that cost, before the motor's torque and the commands under way."""
COMMANDS = 4
"""Commands under way: delays of up to three periods of 25 ms."""
DOUBLINGS = 14
"""Doublings of the Riccati recursion, over 2^14 periods."""


TURN_SHAPE = (1.0, 1.0, 0.68, 0.34, 0.71, 0.12)
"""Share of the tightest turn at the heading errors TURN_ERRORS, as `LqrConfig.turn_shape`."""


class Seen(NamedTuple):
    """States and commands of N bicycles, as regulators see them: without error or delay."""

    lean: np.ndarray
    """(N,) rad."""
    lean_rate: np.ndarray
    """(N,) rad/s."""
    steer: np.ndarray
    """(N,) rad."""
    steer_rate: np.ndarray
    """(N,) rad/s."""
    error: np.ndarray
    """(N,) rad, the heading less the wanted one."""
    speed: np.ndarray
    """(N,) m/s."""
    motor_torque: np.ndarray
    """(N,) N m on the steering now."""
    commands: np.ndarray
    """(N, COMMANDS) N m of the last periods, the newest first."""

    @classmethod
    def of(cls, state: Any, error: np.ndarray, commands: np.ndarray) -> Seen:
        """Return what is seen of a state of the plant whipple."""
        lean, steer = (state.lean_angle, state.lean_rate), (state.steer_angle, state.steer_rate)
        return cls(*lean, *steer, error, state.speed, state.motor_torque, commands)


class Teachers:
    """N regulators, scheduled on speed.

    Attributes:
        speeds: (S,) m/s of the designs.
    """

    def __init__(
        self,
        plant: Plant[Any],
        weights: TeacherWeights,
        turns: TurnConfig,
        speeds: np.ndarray,
        limits: np.ndarray,
    ) -> None:
        """Design them all.

        Args:
            plant: N different bicycles.
            weights: of all of them.
            turns: that they ride.
            speeds: (S,) m/s, evenly spaced.
            limits: (N,) N m, the largest torques.
        """
        self.weights, self.turns, self.speeds, self._limits = weights, turns, speeds, limits
        count = plant.count
        assert count is not None
        delay = parameters_of(plant, ("plant.delay",), count)[:, 0]
        designs = [self._design(plant, float(speed), delay) for speed in speeds]
        # (S, N, numbers): each speed's designs lie together.
        self._table = np.ascontiguousarray(np.stack(designs))
        self._rows = np.arange(count)

    def _design(self, plant: Plant[Any], speed: float, delay: np.ndarray) -> np.ndarray:
        """Return the numbers at one speed, (N, 4 + 1 + COMMANDS + 4).

        Gains on STATES, on the motor's torque and on the commands; lean and torque that hold a
        turn, and yaw rate, per rad of steering; the largest wanted steering, rad.
        """
        model = plant.linearize(speed)
        order = [model.states.index(name) for name in STATES]
        lag = "motor_torque" in model.states
        if lag:
            order.append(model.states.index("motor_torque"))
        a = model.a[..., order, :][..., order]
        b = model.b[..., order, :][..., model.inputs.index("torque")]
        if not lag:  # a motor that follows at once
            a, b = _with_motor(a, b)
        gain = _gains(a, b, delay, plant.time_step, self.weights)
        # Steady: 0 = a (lean, steer, torque) in the rows of the two accelerations.
        two = a[:, [1, 3]]
        steady = np.linalg.solve(two[..., [0, 4]], -two[..., 2][..., None])[..., 0]
        tilt, hold = steady[:, 0], steady[:, 1]
        turn = model.a[:, model.states.index("heading_error"), model.states.index("steer_angle")]
        t = self.turns
        widest = np.full(len(a), t.steer_limit)
        for per, most in ((tilt, t.tilt_limit), (hold, t.hold_share * self._limits)):
            widest = np.minimum(widest, most / np.maximum(np.abs(per), 1e-6))
        return np.column_stack([gain, tilt, hold, turn, widest])

    def choose(self, others: list[Teachers], which: np.ndarray) -> None:
        """Take over other designs of the same bicycles.

        Args:
            others: teachers with other weights.
            which: (S, N) number of the one of `others` to be taken.
        """
        tables = np.stack([other._table for other in others])
        speeds = np.arange(len(self.speeds))[:, None]
        self._table = np.ascontiguousarray(tables[which, speeds, self._rows[None]])

    def at(self, speed: np.ndarray) -> np.ndarray:
        """Return the numbers of `_design` at (N,) speeds, (N, numbers)."""
        first, step = self.speeds[0], self.speeds[1] - self.speeds[0]
        place = np.clip((speed - first) / step, 0.0, len(self.speeds) - 1.0)
        low = np.minimum(place.astype(np.intp), len(self.speeds) - 2)
        share = (place - low)[:, None]
        table, rows = self._table, self._rows
        found: np.ndarray = (1.0 - share) * table[low, rows] + share * table[low + 1, rows]
        return found

    def act(self, seen: Seen) -> np.ndarray:
        """Return the torques, (N,) N m, within the limits."""
        lean, lean_rate, steer, steer_rate, error, speed, motor_torque, commands = seen
        found = self.at(speed)
        k = found.shape[1] - 4
        tilt, hold = found[:, k], found[:, k + 1]
        wanted = self._wanted(found, steer, error)
        beside = np.column_stack(
            [
                lean - tilt * wanted,
                lean_rate,
                steer - wanted,
                steer_rate,
                motor_torque - hold * wanted,
                commands - (hold * wanted)[:, None],
            ]
        )
        torque = hold * wanted - (found[:, :k] * beside).sum(axis=1)
        return np.clip(torque, -self._limits, self._limits)

    def wanted_lean(self, steer: np.ndarray, error: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return the lean of the wanted turns, (N,) rad; arguments as in `Seen`."""
        found = self.at(speed)
        lean: np.ndarray = found[:, -4] * self._wanted(found, steer, error)
        return lean

    def _wanted(self, found: np.ndarray, steer: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Return the steering of the wanted turns, (N,) rad, from the numbers of `at`."""
        turn, widest = found[:, -2], found[:, -1]
        share = np.interp(np.abs(error), TURN_ERRORS, TURN_SHAPE)
        wanted = -error / (self.turns.heading_time * np.maximum(np.abs(turn), 0.05))
        wanted *= np.sign(turn)
        wanted = np.clip(wanted, -widest * share, widest * share)
        wanted += self.turns.damping * (wanted - steer)
        return wanted


def _with_motor(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the model with the torque as a state of its own, that follows within 1 ms."""
    count, n = a.shape[0], a.shape[1]
    whole, rate = np.zeros((count, n + 1, n + 1)), 1000.0
    whole[:, :n, :n], whole[:, :n, n] = a, b
    whole[:, n, n] = -rate
    command = np.zeros((count, n + 1))
    command[:, n] = rate
    return whole, command


def _gains(
    a: np.ndarray, b: np.ndarray, delay: np.ndarray, period: float, w: TeacherWeights
) -> np.ndarray:
    """Return the gains (N, 5 + COMMANDS) of the discrete regulators with delays (N,) s."""
    count = len(a)
    whole = np.floor(delay / period + 1e-9).astype(int)
    early = np.maximum(delay - whole * period, 0.0)
    first = _held(a, b, early)
    second = _held(a, b, period - early)
    n = a.shape[1] + COMMANDS
    m = a.shape[1]
    big, into = np.zeros((count, n, n)), np.zeros((count, n))
    big[:, :m, :m] = second[0] @ first[0]
    effects = np.zeros((count, COMMANDS + 1, m))
    rows = np.arange(count)
    effects[rows, whole] += second[1]
    effects[rows, np.minimum(whole + 1, COMMANDS)] += (second[0] @ first[1][..., None])[..., 0]
    into[:, :m] = effects[:, 0]
    big[:, :m, m:] = effects[:, 1:].transpose(0, 2, 1)
    into[:, m] = 1.0
    for age in range(1, COMMANDS):
        big[:, m + age, m + age - 1] = 1.0
    costs = np.zeros(n)
    costs[:4] = w.lean, w.lean_rate, w.steer, w.steer_rate
    cost = _riccati(big, into, np.diag(costs), w.torque)
    pull = (into[:, None, :] @ cost)[:, 0]
    scale = w.torque + (pull * into).sum(axis=1)
    return np.asarray((pull[:, None, :] @ big)[:, 0] / scale[:, None])


def _riccati(a: np.ndarray, b: np.ndarray, q: np.ndarray, r: float) -> np.ndarray:
    """Return the solutions (N, n, n) of the discrete Riccati equations, by doubling."""
    n = a.shape[1]
    g = b[:, :, None] * b[:, None, :] / r
    h = np.broadcast_to(q, a.shape).copy()
    eye = np.eye(n)
    for _ in range(DOUBLINGS):
        inverse = np.linalg.inv(eye + g @ h)
        left = a @ inverse
        across = a.transpose(0, 2, 1)
        g, h, a = (
            g + left @ g @ across,
            h + across @ h @ inverse @ a,
            left @ a,
        )
        h = 0.5 * (h + h.transpose(0, 2, 1))
    return h


def _held(a: np.ndarray, b: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (N, n, n) and (N, n): the effect of a time (N,) on the state, and of a held input."""
    n = a.shape[1]
    both = np.zeros((len(a), n + 1, n + 1))
    both[:, :n, :n], both[:, :n, n] = a, b
    both *= time[:, None, None]
    norm = float(np.abs(both).sum(-1).max())
    squarings = max(0, int(np.ceil(np.log2(max(norm, 0.25) / 0.25))))
    both /= 2.0**squarings
    grown = np.broadcast_to(np.eye(n + 1), both.shape).copy()
    for order in range(12, 0, -1):
        grown = np.eye(n + 1) + both @ grown / order
    for _ in range(squarings):
        grown = grown @ grown
    return grown[:, :n, :n], grown[:, :n, n]
