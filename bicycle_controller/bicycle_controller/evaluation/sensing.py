"""Ride N bicycles by what their sensors say: falls, and how wrong the estimates are.

Each ride begins at rest, held upright, where the estimator calibrates. Then it rolls at its speed
with a lean of its own, and the controller holds a heading that changes now and then, in gusts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from bicycle_common.geometry import wrap_angle
from bicycle_common.validation import require, require_between
from bicycle_controller.control.riding import Riding
from bicycle_controller.estimation.kalman import Filter
from bicycle_controller.estimation.queue import Arrivals
from bicycle_controller.estimation.states import Estimate
from bicycle_sim.plants.base import Loads, Plant
from bicycle_sim.sensors.settings import SensorSettings
from bicycle_sim.sensors.suite import SensorSuite

if TYPE_CHECKING:
    from bicycle_controller.control.controller import Controller

FALL = math.radians(45.0)
"""rad of lean that counts as a fall."""
SETTLING = 1.0
"""s after the start from which on errors of the estimate count."""
CHUNK = 2000
"""Rides that are simulated together, which bounds the memory."""
TURN_PERIOD = 5.0
"""s between two changes of the heading."""


@dataclass(frozen=True)
class Conditions:
    """Settings of the rides.

    Raises:
        ValueError: on a value that makes no sense.
    """

    sensors: SensorSettings | None = None
    """None lets the controller see the truth."""
    delay: float = 0.0
    """s from a command to the motor."""
    motor_lag: float = 0.0
    """s."""
    torque_limit: float = 7.0
    """N m."""
    torque_step: float = 0.0
    """N m of one digit of the motor's torque."""
    friction: float = 0.0
    """N m of Coulomb friction of the steering."""
    wind: float = 0.0
    """m/s, standard deviation of gusts from the side."""
    start_tilt: float = math.radians(1.0)
    """rad, standard deviation of the lean with which a ride begins."""
    turn: float = math.radians(10.0)
    """rad, standard deviation of a change of the heading."""
    speeds: tuple[float, float] = (2.0, 6.0)
    """m/s, from which each ride's is drawn."""
    duration: float = 20.0
    """s."""

    def __post_init__(self) -> None:
        for name, most in (
            ("delay", 0.5),
            ("motor_lag", 1.0),
            ("torque_step", 5.0),
            ("friction", 20.0),
            ("wind", 20.0),
            ("start_tilt", 0.5),
            ("turn", 1.0),
        ):
            require_between(name, getattr(self, name), 0.0, most)
        require_between("torque_limit", self.torque_limit, 0.1, 100.0)
        require_between("duration", self.duration, 1.0, 600.0)
        low, high = self.speeds
        require(0.5 <= low <= high <= 15.0, "speeds must lie within 0.5 and 15 m/s")

    def applied(self, plant: Plant[Any]) -> Plant[Any]:
        """Return the bicycle with this delay, motor and friction.

        Raises:
            ValueError: when the plant has no motor.
        """
        return plant.with_actuation(
            self.delay, self.torque_limit, self.motor_lag, self.torque_step, self.friction
        )


@dataclass(frozen=True)
class Outcome:
    """Results of N rides."""

    fallen: np.ndarray
    """(N,) bool."""
    fall_time: np.ndarray
    """(N,) s; infinite where it stayed upright."""
    speed: np.ndarray
    """(N,) m/s at the start."""
    roll_rms: np.ndarray
    """(N,) rad, of the lean's error after SETTLING, while upright; zeros without sensors."""
    roll_mean: np.ndarray
    """(N,) rad, its mean."""
    heading_rms: np.ndarray
    """(N,) rad, of the true heading's error against the wanted one."""
    torque_rms: np.ndarray
    """(N,) N m."""

    @classmethod
    def join(cls, parts: list[Outcome]) -> Outcome:
        """Return all rides of several parts."""
        names = [item.name for item in fields(cls)]
        return cls(**{n: np.concatenate([getattr(part, n) for part in parts]) for n in names})

    @property
    def fall_rate(self) -> float:
        """Share of the rides."""
        return float(self.fallen.mean())

    def summary(self) -> dict[str, float]:
        """Figures for a table; degrees where the name says so."""
        degrees = math.degrees
        return {
            "rides": len(self.fallen),
            "falls": int(self.fallen.sum()),
            "fall_rate": self.fall_rate,
            "roll_error_rms_deg": degrees(float(np.sqrt(np.mean(self.roll_rms**2)))),
            "roll_error_mean_deg": degrees(float(np.mean(np.abs(self.roll_mean)))),
            "roll_error_mean_p95_deg": degrees(float(np.quantile(np.abs(self.roll_mean), 0.95))),
            "heading_rms_deg": degrees(float(np.sqrt(np.mean(self.heading_rms**2)))),
            "torque_rms": float(np.sqrt(np.mean(self.torque_rms**2))),
        }


def ride(
    controller: Controller,
    plant: Plant[Any],
    conditions: Conditions,
    count: int,
    seed: int,
    model: Plant[Any] | None = None,
) -> Outcome:
    """Ride `count` bicycles.

    Args:
        controller: answers the six observations and the speed.
        plant: the bicycle; `conditions` are put on it.
        conditions: of the rides.
        count: N.
        seed: of starts, gusts and sensors; not negative.
        model: what the estimator believes; None is the bicycle itself without delay.

    Raises:
        ValueError: on a count or seed that makes no sense, or on a plant without a motor.
    """
    require(count >= 1, f"there must be at least one ride, not {count}")
    require(seed >= 0, f"a seed must be zero or more, not {seed}")
    parts = []
    for index, first in enumerate(range(0, count, CHUNK)):
        number = min(CHUNK, count - first)
        rides = _Rides(controller, plant, conditions, number, 1000 * seed + index, model)
        for _ in range(round(conditions.duration / rides.period)):
            rides.step()
        parts.append(rides.outcome())
    return Outcome.join(parts)


class _Rides:
    """N rides under way."""

    def __init__(
        self,
        controller: Controller,
        plant: Plant[Any],
        conditions: Conditions,
        count: int,
        seed: int,
        model: Plant[Any] | None,
    ) -> None:
        self.conditions = conditions
        self.count = count
        self.riding = Riding(controller, count, conditions.applied(plant))
        self.plant = conditions.applied(plant)
        self.period = self.plant.time_step
        self.rng = np.random.default_rng([seed, 7])
        zero = np.zeros(count)
        self.speed = self.rng.uniform(*conditions.speeds, count)
        self.state = self.plant.initial(zero, zero, zero, self.speed)
        self.filter: Filter | None = None
        if conditions.sensors is not None:
            self.suite = SensorSuite(conditions.sensors, self.plant, count, seed)
            self.filter = Filter(model or self.plant, conditions.sensors, count)
            self.arrivals = Arrivals()
            self.arrivals.add(self.suite.rest(self.state))
            self._take()
        tilt = conditions.start_tilt * self.rng.standard_normal(count)
        self.state = self.plant.settled(replace(self.state, lean_angle=tilt))
        if self.filter is not None:
            self.suite.begin(self.state)
        self.steps = 0
        self.wanted = zero
        self.gust = zero
        self.fall_step = np.full(count, np.inf)
        self.sums = np.zeros((4, count))
        self.counted = zero

    def _take(self) -> None:
        assert self.filter is not None
        for reading, mask in self.arrivals.due(self.suite.time):
            self.filter.take(reading, mask)

    def seen(self) -> tuple[np.ndarray, np.ndarray, Estimate | None]:
        """Observations (N, 6) and speeds (N,), true or estimated."""
        body: Any = self.state
        found = None
        if self.filter is not None:
            body = found = self.filter.estimate(self.suite.time)
        error = wrap_angle(body.heading - self.wanted)
        columns = (
            body.steer_angle,
            body.steer_rate,
            body.lean_angle,
            body.lean_rate,
            body.lean_acceleration,
            error,
        )
        return np.array(columns).T, body.speed, found

    def step(self) -> None:
        """Step all by one control period."""
        c = self.conditions
        if self.steps % round(TURN_PERIOD / self.period) == 0 and self.steps:
            self.wanted = self.wanted + c.turn * self.rng.standard_normal(self.count)
        observation, speed, estimate = self.seen()
        self._count_error(estimate)
        action = self.riding.act(observation, speed)
        torque = np.clip(action[:, 0], -c.torque_limit, c.torque_limit)
        zero = np.zeros(self.count)
        self.riding.acted(observation, speed, np.stack([torque, zero, zero], 1))
        # Gusts last about a second.
        keep = math.exp(-self.period)
        fresh = c.wind * math.sqrt(1.0 - keep * keep) * self.rng.standard_normal(self.count)
        self.gust = keep * self.gust + fresh
        loads = Loads(lateral_force=self._force(), force_height=1.0) if c.wind > 0.0 else None
        limits = (self.speed - 0.1, self.speed + 0.1)
        if self.filter is None:
            self.state = self.plant.step(self.state, torque, zero, zero, limits, loads)
        else:
            trace = self.plant.trace(self.state, torque, zero, zero, limits, loads)
            self.arrivals.add(self.suite.advance(trace, self.period))
            self.state = trace[-1]
        self._count(torque)
        self.steps += 1
        down = self.plant.fallen(self.state, FALL) & np.isinf(self.fall_step)
        self.fall_step[down] = self.steps
        if self.filter is not None:
            self._take()

    def _force(self) -> np.ndarray:
        """Return the force (N,), N, of the gusts on 0.5 m^2, with the wind of riding."""
        air = np.hypot(self.gust, self.speed)
        return 0.5 * 1.2 * 0.5 * air * self.gust

    def _count_error(self, estimate: Estimate | None) -> None:
        """Add the error of what the controller sees."""
        if estimate is None or self.steps * self.period < SETTLING:
            return
        upright = np.isinf(self.fall_step)
        error = np.where(upright, estimate.lean_angle - self.state.lean_angle, 0.0)
        self.sums[0] += error**2
        self.sums[1] += error

    def _count(self, torque: np.ndarray) -> None:
        """Add the heading's error and the torque."""
        if self.steps * self.period < SETTLING:
            return
        upright = np.isinf(self.fall_step)
        self.counted = self.counted + upright
        error = wrap_angle(self.state.heading - self.wanted)
        self.sums[2] += np.where(upright, error, 0.0) ** 2
        self.sums[3] += np.where(upright, torque, 0.0) ** 2  # not a number after some falls

    def outcome(self) -> Outcome:
        """Return the summary of all rides."""
        number = np.maximum(self.counted, 1.0)
        square, mean, heading, torque = self.sums / number
        return Outcome(
            fallen=np.isfinite(self.fall_step),
            fall_time=self.fall_step * self.period,
            speed=self.speed,
            roll_rms=np.sqrt(square),
            roll_mean=mean,
            heading_rms=np.sqrt(heading),
            torque_rms=np.sqrt(torque),
        )
