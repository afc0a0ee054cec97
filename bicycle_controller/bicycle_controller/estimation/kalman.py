"""An extended Kalman filter for N bicycles, whose model is the plant's parameters.

Lean is no sensor's reading. The roll gyro's integral gives it for a second or two; beyond that it
follows from what the bicycle does: a lean that is not the turn's makes it fall, which the gyros,
the steer encoder and the model see. The steering's friction is part of that model: without it a
steering that sticks would seem to turn. The accelerometer adds the lateral force less what the
turn explains; alone it says nothing, for in a steady turn it feels no lean.

Signs are the paper's: lean, steering and yaw rate are positive to the left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bicycle_controller.estimation.history import History
from bicycle_controller.estimation.model import Coefficients, Model, bend
from bicycle_controller.estimation.settings import FilterSettings
from bicycle_sim.plants.base import BodyState, Plant
from bicycle_sim.sensors.reading import Reading
from bicycle_sim.sensors.settings import SensorSettings
from bicycle_sim.sensors.suite import GRAVITY, turned

STATES = (
    "lean_angle",
    "lean_rate",
    "steer_angle",
    "steer_rate",
    "speed",
    "roll_gyro_bias",
    "yaw_gyro_bias",
    "side_force_bias",
    "steer_offset",
)
"""States, the rows of the covariance; rad, rad/s, rad, rad/s, m/s, rad/s, rad/s, m/s^2, rad."""
LEAN, LEAN_RATE, STEER, STEER_RATE, SPEED, ROLL_BIAS, YAW_BIAS, FORCE_BIAS, OFFSET = range(9)

COURSE = ("heading", "x", "y")
"""Rows of the second covariance; rad, m, m."""

STEP = 0.01
"""s, the longest step of the model."""
MEMORY = 0.4
"""s of estimates that are kept; a reading that is older is not used."""


@dataclass(frozen=True)
class Estimate:
    """Motion of N bicycles at one time; arrays (N,) unless said otherwise."""

    time: float
    """s of the sensors' clock."""
    lean_angle: np.ndarray
    lean_rate: np.ndarray
    lean_acceleration: np.ndarray
    """rad/s^2, of the model."""
    steer_angle: np.ndarray
    steer_rate: np.ndarray
    heading: np.ndarray
    yaw_rate: np.ndarray
    speed: np.ndarray
    x: np.ndarray
    """m, rear contact; below too."""
    y: np.ndarray
    biases: np.ndarray
    """(N, 4), the last four of STATES."""
    covariance: np.ndarray
    """(N, 9, 9), of STATES."""
    course_covariance: np.ndarray
    """(N, 3, 3), of COURSE."""
    calibrated: np.ndarray
    """bool: True once the gyros' biases are known from a rest."""


class Filter:
    """The estimates of N bicycles.

    Readings are given in the order of their time stamps, a late one when it comes: it corrects
    what was estimated at its time and all since.
    """

    def __init__(
        self,
        plant: Plant[Any],
        sensors: SensorSettings,
        count: int = 1,
        settings: FilterSettings | None = None,
    ) -> None:
        """Begin at rest, upright, at the origin, heading +y.

        Args:
            plant: whose parameters the model has, and whose geometry; of one bicycle or of N.
            sensors: whose figures are believed: noise, mounting, age.
            count: N.
            settings: the filter's settings.
        """
        self.plant = plant
        self.sensors = sensors
        self.settings = settings or FilterSettings()
        self.count = count
        self._model = Model(plant)
        self._mounting = turned(np.radians(np.array(sensors.imu.mounting)))
        self.restart(0.0)

    def restart(self, time: float) -> None:
        """Forget everything; the bicycle stands at `time`, s of the sensors' clock."""
        s, imu = self.settings, self.sensors.imu
        n = self.count
        self.time = time
        self._x = np.zeros((n, len(STATES)))
        self._p = np.zeros((n, len(STATES), len(STATES)))
        spread = np.zeros(len(STATES))
        spread[LEAN] = math.radians(s.rest_lean) + 1e-6
        spread[ROLL_BIAS] = spread[YAW_BIAS] = max(2.0 * imu.gyro_bias, 1e-6)
        spread[FORCE_BIAS] = max(imu.accelerometer_bias, 1e-4) + GRAVITY * math.radians(
            imu.misalignment
        )
        spread[OFFSET] = max(s.steer_offset, self.sensors.steer.offset)
        self._p[:] = np.diag(spread**2)
        self._course = np.zeros((n, 3))
        self._course_p = np.tile(np.diag([1e-4, 1e-2, 1e-2]), (n, 1, 1))
        self._torque = np.zeros(n)
        self.resting = np.ones(n, dtype=bool)
        """(N,) True while a bicycle stands."""
        self._rested = np.zeros(n)
        self._history = History(round(MEMORY / STEP))
        self._keep()

    def place(self, x: np.ndarray, y: np.ndarray, heading: np.ndarray) -> None:
        """Set the bicycles' places; (N,) m, m, rad."""
        self._course = np.stack([heading, x, y], 1)
        self._history.clear()
        self._keep()

    # Time.

    def advance(self, time: float) -> None:
        """Let the model go on to a time; nothing where that is past."""
        while time - self.time > 1e-9:
            step = min(STEP, time - self.time)
            self._predict(step)
            self.time += step
            self._keep()

    def _keep(self) -> None:
        self._history.add(self.time, np.concatenate([self._x, self._course], axis=1))

    def _predict(self, dt: float) -> None:
        """States and covariance `dt` s later."""
        s, x, p = self.settings, self._x, self._p
        moving = ~self.resting
        self._rested = np.where(self.resting, self._rested + dt, self._rested)
        k = self._model.at(x[:, SPEED])
        self._x, self._course = _moved(self._model, k, x, self._course, self._torque, dt, moving)
        # Covariance: of the four states that move, exact to the second order in dt.
        go = moving[:, None, None]
        jacobian = np.zeros((self.count, 4, 4))
        jacobian[:, 0, 1] = jacobian[:, 2, 3] = 1.0
        jacobian[:, 1], jacobian[:, 3] = k.axes[:, 0], k.axes[:, 1]
        part = jacobian * dt
        grown = np.where(go, np.eye(4) + part + 0.5 * (part @ part), np.eye(4))
        p = p.copy()
        block = grown @ p[:, :4, :4] @ grown.transpose(0, 2, 1)
        p[:, :4, :4] = 0.5 * (block + block.transpose(0, 2, 1))
        p[:, :4, 4:] = grown @ p[:, :4, 4:]
        p[:, 4:, :4] = p[:, :4, 4:].transpose(0, 2, 1)
        per_torque = k.torque[:, :2]
        noise = (s.torque_noise**2 * dt * moving)[:, None, None] * (
            per_torque[:, :, None] * per_torque[:, None, :]
        )
        noise[:, 0, 0] += s.roll_noise**2 * dt * moving
        p[:, 1:4:2, 1:4:2] += noise
        imu = self.sensors.imu
        p[:, SPEED, SPEED] += s.speed_noise**2 * dt * moving
        for index, walk in (
            (ROLL_BIAS, imu.gyro_walk),
            (YAW_BIAS, imu.gyro_walk),
            (FORCE_BIAS, imu.accelerometer_walk),
            (OFFSET, s.offset_walk),
        ):
            p[:, index, index] += walk**2 * dt
        self._p = p
        self._course_p = self._course_after(dt, moving)

    def _course_after(self, dt: float, moving: np.ndarray) -> np.ndarray:
        """The covariance of heading and place `dt` s later."""
        heading, speed = self._course[:, 0], self._x[:, SPEED]
        way = np.tile(np.eye(3), (self.count, 1, 1))
        way[:, 1, 0] = -speed * np.cos(heading) * dt
        way[:, 2, 0] = -speed * np.sin(heading) * dt
        p: np.ndarray = way @ self._course_p @ way.transpose(0, 2, 1)
        turn = self._p[:, YAW_BIAS, YAW_BIAS] + self.settings.course_noise**2
        p[:, 0, 0] += turn * dt * moving
        along = (self._p[:, SPEED, SPEED] * 0.1 + 1e-4) * dt * moving
        p[:, 1, 1] += along
        p[:, 2, 2] += along
        return p

    # Readings.

    def take(self, reading: Reading, mask: np.ndarray | None = None) -> None:
        """Correct the estimates by a reading.

        Args:
            reading: of one sensor.
            mask: (N,) bool, of the bicycles that have received it; None is all.
        """
        self.advance(reading.stamp)
        if reading.stamp < self.time - MEMORY:
            return
        mask = np.ones(self.count, dtype=bool) if mask is None else mask
        known = np.isfinite(reading.values)
        if reading.sensor == "imu":
            values = np.where(mask[:, None] & known, reading.values, 0.0)
            self._take_imu(reading.stamp - self.sensors.imu.age, values, known & mask[:, None])
            return
        mask = mask & known.all(axis=1)
        values = np.where(mask[:, None], reading.values, 0.0)
        if reading.sensor == "steer":
            self._take_steer(reading.stamp - self.sensors.steer.age, values, mask)
        elif reading.sensor == "wheel":
            self._take_wheel(reading.stamp - self.sensors.wheel.age, values, mask)
        else:
            self._take_gnss(reading.stamp - self.sensors.gnss.age, values, mask)

    def _take_imu(self, time: float, values: np.ndarray, known: np.ndarray) -> None:
        """Take an IMU's reading; `known` (N, 6) tells which of its values there are.

        An IMU may lack the yaw gyro or the accelerometers; without a roll gyro it says nothing.
        """
        imu, s = self.sensors.imu, self.settings
        mask = known[:, 0]
        turns: np.ndarray = np.all(known[:, :3], axis=1)
        feels: np.ndarray = np.all(known[:, [0, 3, 4, 5]], axis=1)
        turn, force = values[:, :3] @ self._mounting.T, values[:, 3:] @ self._mounting.T
        noise = imu.gyro_noise**2 * imu.rate + imu.gyro_step**2 / 12.0 + 1e-8
        then = self._history.at(time)
        # With its nose down the frame's own axis feels a share of the turning.
        pitch = self._model.pitch(then[:, LEAN], then[:, STEER]) * ~self.resting
        k = self._model.at(then[:, SPEED])
        felt = pitch * self._rates(k, then)[:, 2] * np.cos(then[:, LEAN])
        error = turn[:, 0] + then[:, LEAN_RATE] - felt - then[:, ROLL_BIAS]
        spread = np.sqrt(self._p[:, ROLL_BIAS, ROLL_BIAS])
        self._leave_rest(mask & (np.abs(error) > s.rest_turn + 4.0 * spread))
        self._correct(time, error, ((LEAN_RATE, -1.0), (ROLL_BIAS, 1.0)), noise, mask)

        moving = (~self.resting).astype(float)
        then = self._history.at(time)
        k = self._model.at(then[:, SPEED])
        cosine = np.cos(then[:, LEAN])
        rates = self._rates(k, then) * moving[:, None]
        tangent = np.tan(np.clip(then[:, STEER], -1.2, 1.2))
        steer_turn, rate_turn = k.axes[:, 2, 2] * moving, k.axes[:, 2, 3] * moving
        slope = 1.0 + tangent * tangent
        speed = np.maximum(then[:, SPEED], 0.1)
        expected = cosine * rates[:, 2] + then[:, YAW_BIAS]
        axes = (
            (STEER, steer_turn * slope),
            (STEER_RATE, rate_turn),
            (SPEED, rates[:, 2] * cosine / speed),
            (YAW_BIAS, 1.0),
        )
        loose = noise + (s.model_turn**2 + (0.05 * rates[:, 2]) ** 2) * moving
        self._correct(time, turn[:, 2] - expected, axes, loose, turns)
        self._take_force(time, force[:, 1], feels)

    def _take_force(self, time: float, side: np.ndarray, mask: np.ndarray) -> None:
        """The accelerometer across the frame, m/s^2 to the left."""
        imu, s = self.sensors.imu, self.settings
        ahead, _, height = imu.position
        moving = (~self.resting).astype(float)
        then = self._history.at(time)
        k = self._model.at(then[:, SPEED])
        rates = self._rates(k, then) * moving[:, None]
        sine, cosine = np.sin(then[:, LEAN]), np.cos(then[:, LEAN])
        speed, yaw = then[:, SPEED], rates[:, 2]
        steer_turn, rate_turn = k.axes[:, 2, 2], k.axes[:, 2, 3]
        turn_up = (steer_turn * then[:, STEER_RATE] + rate_turn * rates[:, 1]) * moving
        # A point above the road swings on a smaller circle than the contact.
        expected = (
            (speed - height * yaw * sine) * yaw * cosine
            - GRAVITY * sine
            + height * rates[:, 0]
            + ahead * turn_up
            + then[:, FORCE_BIAS]
        )
        a, c = k.axes[:, 0], k.axes[:, 1]
        lever, swing = height * moving, ahead * rate_turn * moving
        axes = (
            (LEAN, -GRAVITY * cosine + lever * a[:, 0] + swing * c[:, 0]),
            (LEAN_RATE, lever * a[:, 1] + swing * c[:, 1]),
            (STEER, (speed * steer_turn) * moving + lever * a[:, 2] + swing * c[:, 2]),
            (
                STEER_RATE,
                (speed * rate_turn + ahead * steer_turn) * moving
                + lever * a[:, 3]
                + swing * c[:, 3],
            ),
            (SPEED, 2.0 * yaw),
            (FORCE_BIAS, 1.0),
        )
        noise = imu.accelerometer_noise**2 * imu.rate + imu.accelerometer_step**2 / 12.0 + 1e-8
        loose = noise + (imu.vibration**2 + s.model_force**2) * moving
        self._correct(time, side - expected, axes, loose, mask, s.gate)

    def _take_steer(self, time: float, values: np.ndarray, mask: np.ndarray) -> None:
        steer = self.sensors.steer
        quantum = 2.0 * math.pi / steer.counts if steer.counts > 0 else 0.0
        noise = steer.noise**2 + quantum**2 / 12.0 + 1e-8
        then = self._history.at(time)
        error = values[:, 0] - then[:, STEER] - then[:, OFFSET]
        # At rest it may be turned by hand; the angle follows, and the zero is not learned.
        still = mask & self.resting
        self._x[still, STEER] += error[still]
        error = np.where(still, 0.0, error)
        self._correct(time, error, ((STEER, 1.0), (OFFSET, 1.0)), noise, mask & ~still)
        self._torque = np.where(mask, values[:, 1], self._torque)

    def _take_wheel(self, time: float, values: np.ndarray, mask: np.ndarray) -> None:
        wheel = self.sensors.wheel
        speed = values[:, 0]
        self._leave_rest(mask & (np.abs(speed) > self.settings.rest_speed), speed)
        time -= 0.5 * wheel.average
        noise = (0.01 + 0.5 * wheel.scale * np.abs(speed)) ** 2
        if wheel.ticks > 0 and wheel.average > 0:
            tick = 2.0 * math.pi * self.plant.geometry.rear_radius / wheel.ticks / wheel.average
            noise = noise + tick**2 / 6.0
        then = self._history.at(time)
        self._correct(time, speed - then[:, SPEED], ((SPEED, 1.0),), noise, mask & ~self.resting)

    def _leave_rest(self, mask: np.ndarray, speed: np.ndarray | None = None) -> None:
        """Let bicycles ride that stood."""
        mask = mask & self.resting
        if not mask.any():
            return
        self.resting = self.resting & ~mask
        s = self.settings
        for index, spread in (
            (LEAN, math.radians(s.launch_lean)),
            (LEAN_RATE, 0.1),
            (STEER, 0.01),
            (STEER_RATE, 0.1),
            (SPEED, 0.5 if speed is not None else 3.0),
        ):
            self._p[mask, index, index] += spread**2
        if speed is not None:
            self._x[mask, SPEED] = speed[mask]
            change = np.zeros((self.count, len(STATES) + 3))
            change[mask, SPEED] = speed[mask]
            self._history.correct(-math.inf, change)

    def _take_gnss(self, time: float, values: np.ndarray, mask: np.ndarray) -> None:
        """A fix, and the direction of the velocity."""
        g = self.sensors.gnss
        then = self._history.at(time)
        lean, course = then[:, LEAN], then[:, len(STATES) :]
        heading = course[:, 0]
        sine, cosine = np.sin(heading), np.cos(heading)
        ahead, left, height = g.position
        across = left + height * np.sin(lean)
        at_x = course[:, 1] - sine * ahead - cosine * across
        at_y = course[:, 2] + cosine * ahead - sine * across
        noise = g.noise**2 + g.wander**2 + 1e-6
        for error, axis, per_heading in (
            (values[:, 0] - at_x, 1, -cosine * ahead + sine * across),
            (values[:, 1] - at_y, 2, -sine * ahead - cosine * across),
        ):
            self._correct_course(time, error, axis, per_heading, noise, mask)
        speed = np.hypot(values[:, 2], values[:, 3])
        fast = mask & (speed > 1.0) & ~self.resting
        k = self._model.at(then[:, SPEED])
        yaw = self._rates(k, then)[:, 2]
        sideways = ahead * yaw + height * np.cos(lean) * then[:, LEAN_RATE]
        slip = np.arctan2(sideways, np.maximum(then[:, SPEED], 0.5))
        measured = np.arctan2(-values[:, 2], values[:, 3]) - slip
        error = np.remainder(measured - heading + np.pi, 2.0 * np.pi) - np.pi
        spread = (g.velocity_noise / np.maximum(speed, 0.5)) ** 2 + 0.01**2
        self._correct_course(time, error, 0, 1.0, spread, fast)
        self._course[:, 0] = np.remainder(self._course[:, 0] + np.pi, 2.0 * np.pi) - np.pi

    def _rates(self, k: Coefficients, x: np.ndarray) -> np.ndarray:
        """(N, 3), `model.ROWS` under the reported torque."""
        return _rates(self._model, k, x, self._torque)

    def _correct(
        self,
        time: float,
        error: np.ndarray,
        axes: tuple[tuple[int, Any], ...],
        noise: Any,
        mask: np.ndarray,
        gate: float = math.inf,
    ) -> None:
        """Correct the estimates by one measurement.

        Args:
            time: s that it is of.
            error: (N,) measured less expected.
            axes: index of a state and (N,) or number, the derivative of what is measured.
            noise: (N,) or number, its variance.
            mask: (N,) bool, of bicycles that have it.
            gate: standard deviations beyond which it is not believed.
        """
        slopes = [(index, np.asarray(slope, dtype=float)) for index, slope in axes]
        ph = np.zeros((self.count, len(STATES)))
        for index, slope in slopes:
            ph += self._p[:, :, index] * slope.reshape(-1, 1)
        total = np.zeros(self.count) + noise
        for index, slope in slopes:
            total += slope * ph[:, index]
        if gate < math.inf:
            mask = mask & (error * error < gate * gate * total)
        inverse = mask / total
        change = ph * (error * inverse)[:, None]
        self._x = self._x + change
        self._p = self._p - ph[:, :, None] * (ph * inverse[:, None])[:, None, :]
        self._history.correct(time, np.concatenate([change, np.zeros((self.count, 3))], axis=1))

    def _correct_course(
        self,
        time: float,
        error: np.ndarray,
        axis: int,
        per_heading: Any,
        noise: Any,
        mask: np.ndarray,
    ) -> None:
        """Correct heading and place by a measurement along `axis` of COURSE."""
        h = np.zeros((self.count, 3))
        h[:, axis] = 1.0
        if axis != 0:
            h[:, 0] = per_heading
        ph = np.einsum("nij,nj->ni", self._course_p, h)
        total = np.einsum("ni,ni->n", ph, h) + noise
        mask = mask & (error * error < self.settings.gate**2 * total)
        inverse = mask / total
        change = ph * (error * inverse)[:, None]
        self._course = self._course + change
        self._course_p = self._course_p - ph[:, :, None] * (ph * inverse[:, None])[:, None, :]
        wide = np.concatenate([np.zeros((self.count, len(STATES))), change], axis=1)
        self._history.correct(time, wide)

    # Estimates.

    def estimate(self, time: float | None = None) -> Estimate:
        """Return the estimate at a time not before the last reading's; None is that time.

        The model goes on alone to there; the filter's own state stays where it is.
        """
        x, course, now = self._x, self._course, self.time
        moving = ~self.resting
        while time is not None and time - now > 1e-9:
            dt = min(STEP, time - now)
            k = self._model.at(x[:, SPEED])
            x, course = _moved(self._model, k, x, course, self._torque, dt, moving)
            now += dt
        k = self._model.at(x[:, SPEED])
        rates = self._rates(k, x) * moving[:, None]
        return Estimate(
            time=now,
            lean_angle=x[:, LEAN].copy(),
            lean_rate=x[:, LEAN_RATE].copy(),
            lean_acceleration=rates[:, 0].copy(),
            steer_angle=x[:, STEER].copy(),
            steer_rate=x[:, STEER_RATE].copy(),
            heading=course[:, 0].copy(),
            yaw_rate=rates[:, 2].copy(),
            speed=x[:, SPEED].copy(),
            x=course[:, 1].copy(),
            y=course[:, 2].copy(),
            biases=x[:, ROLL_BIAS:].copy(),
            covariance=self._p.copy(),
            course_covariance=self._course_p.copy(),
            calibrated=self._p[:, ROLL_BIAS, ROLL_BIAS] < 0.003**2,
        )


def _rates(
    model: Model, k: Coefficients, x: np.ndarray, torque: np.ndarray, dt: float = STEP
) -> np.ndarray:
    free = model.rates(k, x[:, LEAN], bend(x)) + k.torque * torque[:, None]
    return model.gripped(k, free, x[:, STEER_RATE], dt)


def _moved(
    model: Model,
    k: Coefficients,
    x: np.ndarray,
    course: np.ndarray,
    torque: np.ndarray,
    dt: float,
    moving: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """States and course `dt` s later, by the midpoint rule; unchanged where not `moving`."""
    share = dt * moving[:, None]

    def slopes(at: np.ndarray, left: float) -> tuple[np.ndarray, np.ndarray]:
        rates = _rates(model, k, at, torque, left)
        found = np.zeros_like(at)
        found[:, LEAN], found[:, STEER] = at[:, LEAN_RATE], at[:, STEER_RATE]
        found[:, LEAN_RATE], found[:, STEER_RATE] = rates[:, 0], rates[:, 1]
        return found, rates[:, 2]

    first, _ = slopes(x, dt)
    second, yaw = slopes(x + 0.5 * share * first, 0.5 * dt)
    turned_by = yaw * share[:, 0]
    middle = course[:, 0] + 0.5 * turned_by
    way = x[:, SPEED] * share[:, 0]
    heading = course[:, 0] + turned_by
    heading = np.remainder(heading + np.pi, 2.0 * np.pi) - np.pi
    gone = np.stack(
        [heading, course[:, 1] - way * np.sin(middle), course[:, 2] + way * np.cos(middle)], 1
    )
    return x + share * second, gone


def as_body(plant: Plant[Any], estimate: Estimate) -> BodyState:
    """The estimate as a state of the plant, with contacts that fit it."""
    state = plant.initial(estimate.x, estimate.y, estimate.heading, estimate.speed)
    state = replace(
        state,
        lean_angle=estimate.lean_angle,
        lean_rate=estimate.lean_rate,
        lean_acceleration=estimate.lean_acceleration,
        steer_angle=estimate.steer_angle,
        steer_rate=estimate.steer_rate,
    )
    return plant.settled(state)
