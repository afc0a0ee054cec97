"""The filter's equations for N bicycles, in numpy.

`estimator.cpp` has the same operations in the same order, so that both give the same bits:
products and sums one by one, no sum whose order a library chooses, no function but `trigonometry`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from bicycle_controller.estimation.model import Model
from bicycle_controller.estimation.states import (
    COURSE,
    FORCE_BIAS,
    GUST,
    HEADING,
    LEAN,
    LEAN_RATE,
    OFFSET,
    ROLL_BIAS,
    SPEED,
    STATES,
    STEER,
    STEER_RATE,
    YAW_BIAS,
    X,
    Y,
)
from bicycle_sim.plants.whipple.trigonometry import sine_cosine, sine_cosine_of_turn
from bicycle_sim.sensors.suite import GRAVITY

STEP = 0.01
"""s, the longest step of the model."""
MOVING = 5
"""States that move by the model, the first ones."""
STEEPEST_STEER = 1.2
"""rad of steering beyond which its tangent is not followed."""
STEEPEST_LEAN = 1.5
"""rad of lean beyond which its sine is not followed."""
SLOWEST = 0.1
"""m/s below which a turn tells nothing of the speed."""
TURN_SHARE = 0.05
"""Standard deviation of the modelled yaw rate, as a share of it; added to the configured one."""


class ImuReadings(IntEnum):
    """Measurements of an IMU that the model explains."""

    ROLL_TURN = 0
    YAW_TURN = 1
    SIDE_FORCE = 2


class Numbers(NamedTuple):
    """Settings as the equations use them: variances, and what else stays."""

    roll_noise: float
    """(rad/s^2)^2 s; so are the next ones, each of its state, per s."""
    torque_noise: float
    gust_noise: float
    speed_noise: float
    gyro_walk: float
    force_walk: float
    offset_walk: float
    course_noise: float
    gust_decay: float
    """1/s."""
    turn_noise: float
    """(rad/s)^2 of a gyro's reading."""
    turn_model: float
    """(rad/s)^2 beside it, while the bicycle moves."""
    force_noise: float
    """(m/s^2)^2 of the accelerometer's reading."""
    force_model: float
    """(m/s^2)^2 beside it, while the bicycle moves."""
    ahead: float
    """m, of the IMU before the rear contact."""
    height: float
    """m, of the IMU above the ground."""


@dataclass(frozen=True)
class Belief:
    """Memory of the filter; its arrays are changed in place, for compiled code points to them."""

    state: np.ndarray
    """(N, 13), STATES and COURSE."""
    covariance: np.ndarray
    """(N, 10, 10), of STATES."""
    course_covariance: np.ndarray
    """(N, 3, 3), of COURSE."""
    torque: np.ndarray
    """(N,) N m on the steering, as reported."""
    moving: np.ndarray
    """(N,) 1.0 where the bicycle moves, 0.0 where it rests."""

    @classmethod
    def empty(cls, count: int) -> Belief:
        """Return zeros for N bicycles."""
        n, k, c = count, len(STATES), len(COURSE)
        zeros = (np.zeros(shape) for shape in ((n, k + c), (n, k, k), (n, c, c), (n,), (n,)))
        return cls(*zeros)


class Expected(NamedTuple):
    """Expectation of a measurement."""

    value: np.ndarray
    """(N,)."""
    slopes: np.ndarray
    """(N, 10), its derivatives by STATES."""
    noise: np.ndarray
    """(N,), variance of measured less expected."""


class _Rates(NamedTuple):
    """Accelerations and yaw rate (N,), and what they were made from."""

    lean: np.ndarray
    steer: np.ndarray
    yaw: np.ndarray
    sine: np.ndarray
    cosine: np.ndarray
    tangent: np.ndarray


class Arithmetic:
    """The equations on one belief."""

    def __init__(self, model: Model, numbers: Numbers, belief: Belief) -> None:
        """Take what they work on.

        Args:
            model: of the bicycles.
            numbers: settings.
            belief: of the bicycles; `predict` and `correct` change it.
        """
        self.model = model
        self.numbers = numbers
        self.belief = belief

    def _axes(self, state: np.ndarray) -> np.ndarray:
        """(N, 3, 4), `model.ROWS` on `model.AXES` at the state's speeds."""
        v = state[:, SPEED][:, None, None]
        constant, first, second = self.model.powers
        found: np.ndarray = constant + v * (first + v * second)
        return found

    def _rates(self, axes: np.ndarray, state: np.ndarray, dt: float) -> _Rates:
        """Return the rates under the reported torque, a gust and the steering's friction.

        Coulomb friction brings the steering to rest within `dt` s where it can, and else takes its
        whole torque. Without it, the model turns a steering that sticks.
        """
        sine, cosine = sine_cosine(_bounded(state[:, LEAN], STEEPEST_LEAN))
        steer_sine, steer_cosine = sine_cosine(_bounded(state[:, STEER], STEEPEST_STEER))
        tangent = steer_sine / steer_cosine
        bent = (sine, state[:, LEAN_RATE], tangent, state[:, STEER_RATE])
        lean, steer, yaw = (
            ((axes[:, row, 0] * bent[0] + axes[:, row, 1] * bent[1]) + axes[:, row, 2] * bent[2])
            + axes[:, row, 3] * bent[3]
            for row in range(3)
        )
        lean = lean + axes[:, 0, 0] * state[:, GUST]
        steer = steer + axes[:, 1, 0] * state[:, GUST]
        yaw = yaw / cosine
        per, friction = self.model.torque, self.model.friction
        torque = self.belief.torque
        lean, steer, yaw = (
            value + per[:, row] * torque for row, value in enumerate((lean, steer, yaw))
        )
        needed = -(state[:, STEER_RATE] / dt + steer) / per[:, 1]
        held = np.where(needed < -friction, -friction, needed)
        held = np.where(held > friction, friction, held)
        lean, steer, yaw = (
            value + per[:, row] * held for row, value in enumerate((lean, steer, yaw))
        )
        return _Rates(lean, steer, yaw, sine, cosine, tangent)

    def rates(self, state: np.ndarray) -> np.ndarray:
        """(N, 3), lean's and steering's acceleration and the yaw rate of states (N, 13)."""
        found = self._rates(self._axes(state), state, STEP)
        return np.stack([found.lean, found.steer, found.yaw], 1)

    def move(self, state: np.ndarray, dt: float) -> None:
        """Move states (N, 13) on by `dt` s, in place, by the midpoint rule, where they move."""
        axes, share = self._axes(state), dt * self.belief.moving
        half = 0.5 * share
        first = self._rates(axes, state, dt)
        middle = state.copy()
        middle[:, LEAN] += half * state[:, LEAN_RATE]
        middle[:, LEAN_RATE] += half * first.lean
        middle[:, STEER] += half * state[:, STEER_RATE]
        middle[:, STEER_RATE] += half * first.steer
        second = self._rates(axes, middle, 0.5 * dt)
        state[:, LEAN] += share * middle[:, LEAN_RATE]
        state[:, LEAN_RATE] += share * second.lean
        state[:, STEER] += share * middle[:, STEER_RATE]
        state[:, STEER_RATE] += share * second.steer
        state[:, GUST] -= share * (self.numbers.gust_decay * state[:, GUST])
        turned = second.yaw * share
        sine, cosine = sine_cosine_of_turn(state[:, HEADING] + 0.5 * turned)
        way = state[:, SPEED] * share
        state[:, X] -= way * sine
        state[:, Y] += way * cosine
        state[:, HEADING] = wrapped(state[:, HEADING] + turned)

    def predict(self, dt: float) -> None:
        """Let the belief grow older by `dt` s, at most STEP."""
        b = self.belief
        axes = self._axes(b.state)
        self._spread(axes, dt)
        self.move(b.state, dt)
        self._spread_course(dt)

    def _spread(self, axes: np.ndarray, dt: float) -> None:
        """Covariance of STATES `dt` s later; of those that move, exact to the second order."""
        n, p, moving = self.numbers, self.belief.covariance, self.belief.moving
        part = np.zeros((len(p), MOVING, MOVING))
        part[:, LEAN, LEAN_RATE] = part[:, STEER, STEER_RATE] = dt
        part[:, LEAN_RATE, :GUST], part[:, STEER_RATE, :GUST] = axes[:, 0] * dt, axes[:, 1] * dt
        part[:, LEAN_RATE, GUST], part[:, STEER_RATE, GUST] = (
            axes[:, 0, 0] * dt,
            axes[:, 1, 0] * dt,
        )
        part[:, GUST, GUST] = -n.gust_decay * dt
        grown = (part + 0.5 * _product(part, part)) * moving[:, None, None]
        grown = grown + np.eye(MOVING)
        block = _product(_product(grown, p[:, :MOVING, :MOVING]), grown.transpose(0, 2, 1))
        across = _product(grown, p[:, :MOVING, MOVING:])
        p[:, :MOVING, :MOVING] = 0.5 * (block + block.transpose(0, 2, 1))
        p[:, :MOVING, MOVING:] = across
        p[:, MOVING:, :MOVING] = across.transpose(0, 2, 1)

        go = dt * moving
        per, torque = self.model.torque, n.torque_noise * go
        p[:, LEAN_RATE, LEAN_RATE] += torque * (per[:, 0] * per[:, 0]) + n.roll_noise * go
        both = torque * (per[:, 0] * per[:, 1])
        p[:, LEAN_RATE, STEER_RATE] += both
        p[:, STEER_RATE, LEAN_RATE] += both
        p[:, STEER_RATE, STEER_RATE] += torque * (per[:, 1] * per[:, 1])
        p[:, GUST, GUST] += n.gust_noise * go
        p[:, SPEED, SPEED] += n.speed_noise * go
        p[:, ROLL_BIAS, ROLL_BIAS] += n.gyro_walk * dt
        p[:, YAW_BIAS, YAW_BIAS] += n.gyro_walk * dt
        p[:, FORCE_BIAS, FORCE_BIAS] += n.force_walk * dt
        p[:, OFFSET, OFFSET] += n.offset_walk * dt

    def _spread_course(self, dt: float) -> None:
        """Covariance of heading and place `dt` s later."""
        b = self.belief
        p, state, go = b.course_covariance, b.state, dt * b.moving
        sine, cosine = sine_cosine_of_turn(state[:, HEADING])
        way = np.tile(np.eye(3), (len(p), 1, 1))
        way[:, 1, 0] = -(state[:, SPEED] * cosine) * dt
        way[:, 2, 0] = -(state[:, SPEED] * sine) * dt
        p[:] = _product(_product(way, p), way.transpose(0, 2, 1))
        turn = b.covariance[:, YAW_BIAS, YAW_BIAS] + self.numbers.course_noise
        along = b.covariance[:, SPEED, SPEED] * 0.1 + 1e-4
        p[:, 0, 0] += turn * go
        p[:, 1, 1] += along * go
        p[:, 2, 2] += along * go

    def expected(self, what: ImuReadings, then: np.ndarray) -> Expected:
        """Return what an IMU should measure in states `then` (N, 13).

        Compiled, the answer is good until the next call.
        """
        axes = self._axes(then)
        found = self._rates(axes, then, STEP)
        slopes = np.zeros((len(then), len(STATES)))
        make = (self._roll_turn, self._yaw_turn, self._side_force)[what]
        value, noise = make(then, axes, found, slopes)
        return Expected(value, slopes, noise)

    def _roll_turn(
        self, then: np.ndarray, axes: np.ndarray, found: _Rates, slopes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Roll gyro: with its nose down, the frame's own axis feels a share of the turning."""
        del axes
        lean, steer = then[:, LEAN], then[:, STEER]
        first, second, third = self.model.pitch
        pitch = (first * steer) * steer + (second * steer) * lean + (third * lean) * lean
        felt = (pitch * self.belief.moving) * found.yaw * found.cosine
        slopes[:, LEAN_RATE] = -1.0
        slopes[:, ROLL_BIAS] = 1.0
        value = felt - then[:, LEAN_RATE] + then[:, ROLL_BIAS]
        return value, np.full(len(then), self.numbers.turn_noise)

    def _yaw_turn(
        self, then: np.ndarray, axes: np.ndarray, found: _Rates, slopes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        n, moving = self.numbers, self.belief.moving
        yaw = found.yaw * moving
        slopes[:, STEER] = axes[:, 2, 2] * moving * (1.0 + found.tangent * found.tangent)
        slopes[:, STEER_RATE] = axes[:, 2, 3] * moving
        speed = then[:, SPEED]
        slopes[:, SPEED] = yaw * found.cosine / np.where(speed < SLOWEST, SLOWEST, speed)
        slopes[:, YAW_BIAS] = 1.0
        loose = TURN_SHARE * yaw
        noise = n.turn_noise + (n.turn_model + loose * loose) * moving
        return found.cosine * yaw + then[:, YAW_BIAS], noise

    def _side_force(
        self, then: np.ndarray, axes: np.ndarray, found: _Rates, slopes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Accelerometer across the frame, m/s^2 to the left.

        A point above the road swings on a smaller circle than the contact.
        """
        n, moving = self.numbers, self.belief.moving
        speed, yaw = then[:, SPEED], found.yaw * moving
        rolls, steers = found.lean * moving, found.steer * moving
        steer_turn, rate_turn = axes[:, 2, 2], axes[:, 2, 3]
        turn_up = (steer_turn * then[:, STEER_RATE] + rate_turn * steers) * moving
        value = (speed - n.height * yaw * found.sine) * yaw * found.cosine
        value = value - GRAVITY * found.sine
        value = value + n.height * rolls
        value = value + n.ahead * turn_up
        value = value + then[:, FORCE_BIAS]
        a, c = axes[:, 0], axes[:, 1]
        lever, swing = n.height * moving, n.ahead * rate_turn * moving
        by_accelerations = [lever * a[:, axis] + swing * c[:, axis] for axis in range(4)]
        slopes[:, LEAN] = by_accelerations[0] - GRAVITY * found.cosine
        slopes[:, LEAN_RATE] = by_accelerations[1]
        slopes[:, STEER] = by_accelerations[2] + speed * steer_turn * moving
        slopes[:, STEER_RATE] = (
            by_accelerations[3] + (speed * rate_turn + n.ahead * steer_turn) * moving
        )
        slopes[:, GUST] = by_accelerations[0]
        slopes[:, SPEED] = 2.0 * yaw
        slopes[:, FORCE_BIAS] = 1.0
        return value, n.force_noise + n.force_model * moving

    def correct(
        self,
        error: np.ndarray,
        slopes: np.ndarray,
        noise: np.ndarray,
        mask: np.ndarray,
        gate: float,
    ) -> np.ndarray:
        """Correct the belief by one measurement.

        Args:
            error: (N,) measured less expected.
            slopes: (N, 10), derivatives of what is measured by STATES.
            noise: (N,), its variance.
            mask: (N,) bool, of bicycles that have it.
            gate: standard deviations beyond which it is not believed; infinite for none.

        Returns:
            The change (N, 13) of the states; compiled, it is good until the next call.
        """
        b = self.belief
        p = b.covariance
        reach = p[:, :, 0] * slopes[:, 0, None]
        for axis in range(1, len(STATES)):
            reach = reach + p[:, :, axis] * slopes[:, axis, None]
        total = noise + slopes[:, 0] * reach[:, 0]
        for axis in range(1, len(STATES)):
            total = total + slopes[:, axis] * reach[:, axis]
        believed = mask & (error * error < gate * gate * total)
        inverse = believed / total
        change = np.zeros_like(b.state)
        change[:, : len(STATES)] = reach * (error * inverse)[:, None]
        b.state[:] += change
        p -= reach[:, :, None] * (reach * inverse[:, None])[:, None, :]
        return change


def wrapped(angle: np.ndarray) -> np.ndarray:
    """Return angles (N,) within -pi and pi, for those that are less than a turn beyond."""
    turn = 2.0 * np.pi
    angle = np.where(angle > np.pi, angle - turn, angle)
    return np.where(angle < -np.pi, angle + turn, angle)


def _bounded(value: np.ndarray, most: float) -> np.ndarray:
    return np.where(value < -most, -most, np.where(value > most, most, value))


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Product of matrices (N, i, k) and (N, k, j), summed in the order of k."""
    found = a[:, :, 0, None] * b[:, None, 0, :]
    for k in range(1, a.shape[2]):
        found = found + a[:, :, k, None] * b[:, None, k, :]
    return found
