"""An extended Kalman filter for N bicycles, whose model is the plant's parameters.

Lean is no sensor's reading. The roll gyro's integral gives it for a second or two; beyond that it
follows from what the bicycle does: a lean that is not the turn's makes it fall, which the gyros,
the steer encoder and the model see. Wind pushes as a lean does, but is not felt as one: the
accelerometer tells them apart. The steering's friction is part of that model: without it a
steering that sticks would seem to turn. The accelerometer adds the lateral force less what the
turn explains; alone it says nothing, for in a steady turn it feels no lean.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from bicycle_controller.estimation.arithmetic import (
    STEP,
    Arithmetic,
    Belief,
    ImuReadings,
    Numbers,
    wrapped,
)
from bicycle_controller.estimation.history import History
from bicycle_controller.estimation.model import Model
from bicycle_controller.estimation.native import arithmetic
from bicycle_controller.estimation.settings import FilterSettings
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
    Estimate,
    X,
    Y,
)
from bicycle_sim.plants.base import BodyState, Plant
from bicycle_sim.sensors.reading import Reading
from bicycle_sim.sensors.settings import SensorSettings
from bicycle_sim.sensors.suite import GRAVITY, turned

MEMORY = 0.4
"""s of estimates that are kept; a reading that is older is not used."""
CALIBRATED = 0.003
"""rad/s, standard deviation of a gyro's bias below which it is known."""


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
        compiled: bool = True,
    ) -> None:
        """Begin at rest, upright, at the origin, heading +y.

        Args:
            plant: whose parameters the model has, and whose geometry; of one bicycle or of N.
            sensors: whose figures are believed: noise, mounting, age.
            count: N.
            settings: the filter's settings.
            compiled: False takes numpy, for the same bits.
        """
        self.plant = plant
        self.sensors = sensors
        self.settings = settings or FilterSettings()
        self.count = count
        self._mounting = turned(np.radians(np.array(sensors.imu.mounting)))
        self._belief = Belief.empty(count)
        self._gust = self.settings.gust_force / (plant.geometry.mass * GRAVITY)
        numbers = _numbers(self.settings, sensors, self._gust)
        make = arithmetic if compiled else Arithmetic
        self._arithmetic = make(Model(plant), numbers, self._belief)
        self._history = History(round(MEMORY / STEP), self._belief.state.shape)
        self._tick = 0.0
        if sensors.wheel.ticks > 0 and sensors.wheel.average > 0:
            turn = 2.0 * math.pi * plant.geometry.rear_radius
            self._tick = turn / sensors.wheel.ticks / sensors.wheel.average
        self._steer_slopes = self._slopes(STEER, OFFSET)
        self._wheel_slopes = self._slopes(SPEED)
        self.restart(0.0)

    def _slopes(self, *states: int) -> np.ndarray:
        """(N, 10), of a measurement that is the sum of states."""
        found = np.zeros((self.count, len(STATES)))
        found[:, states] = 1.0
        return found

    def restart(self, time: float) -> None:
        """Forget everything; the bicycle stands at `time`, s of the sensors' clock."""
        s, imu, b = self.settings, self.sensors.imu, self._belief
        self.time = time
        b.state[:] = b.torque[:] = b.moving[:] = 0.0
        spread = np.zeros(len(STATES))
        spread[LEAN] = math.radians(s.rest_lean) + 1e-6
        spread[ROLL_BIAS] = spread[YAW_BIAS] = max(2.0 * imu.gyro_bias, 1e-6)
        spread[FORCE_BIAS] = max(imu.accelerometer_bias, 1e-4) + GRAVITY * math.radians(
            imu.misalignment
        )
        spread[OFFSET] = max(s.steer_offset, self.sensors.steer.offset)
        b.covariance[:] = np.diag(spread * spread)
        b.course_covariance[:] = np.diag([1e-4, 1e-2, 1e-2])
        self._history.clear()
        self._keep()

    @property
    def resting(self) -> np.ndarray:
        """(N,) True while a bicycle stands."""
        found: np.ndarray = self._belief.moving == 0.0
        return found

    @property
    def yaw_bias(self) -> np.ndarray:
        """(N,) rad/s, of the yaw gyro, as far as it is known."""
        return self._belief.state[:, YAW_BIAS].copy()

    def place(self, x: np.ndarray, y: np.ndarray, heading: np.ndarray) -> None:
        """Set the bicycles' places; (N,) m, m, rad."""
        state = self._belief.state
        state[:, HEADING], state[:, X], state[:, Y] = heading, x, y
        self._history.clear()
        self._keep()

    def advance(self, time: float) -> None:
        """Let the model go on to a time; nothing where that is past."""
        while time - self.time > 1e-9:
            step = min(STEP, time - self.time)
            self._arithmetic.predict(step)
            self.time += step
            self._keep()

    def _keep(self) -> None:
        self._history.add(self.time, self._belief.state)

    def take(self, reading: Reading, mask: np.ndarray | None = None) -> None:
        """Correct the estimates by a reading.

        Args:
            reading: of one sensor.
            mask: (N,) bool, of the bicycles that have received it; None is all.
        """
        self.advance(reading.stamp)
        if reading.stamp < self.time - MEMORY:
            return
        known = np.isfinite(reading.values)
        if mask is not None:
            known = known & mask[:, None]
        values = np.where(known, reading.values, 0.0)
        time = reading.stamp - float(getattr(self.sensors, reading.sensor).age)
        if reading.sensor == "imu":
            self._take_imu(time, values, known)
            return
        whole: np.ndarray = known.all(axis=1)
        if reading.sensor == "steer":
            self._take_steer(time, values, whole)
        elif reading.sensor == "wheel":
            self._take_wheel(time, values, whole)
        else:
            self._take_gnss(time, values, whole)

    def _take_imu(self, time: float, values: np.ndarray, known: np.ndarray) -> None:
        """Take an IMU's reading; `known` (N, 6) tells which of its values there are.

        An IMU may lack the yaw gyro or the accelerometers; without a roll gyro it says nothing.
        """
        # Into the frame's axes, summed in an order of our own.
        parts = values.reshape(-1, 2, 1, 3) * self._mounting
        turn_force = (parts[..., 0] + parts[..., 1]) + parts[..., 2]
        roll, yaw, side = turn_force[:, 0, 0], turn_force[:, 0, 2], turn_force[:, 1, 1]
        there = known[:, 0]
        expected = self._arithmetic.expected(ImuReadings.ROLL_TURN, self._history.at(time))
        error = roll - expected.value
        resting = self.resting
        if resting.any():
            spread = np.sqrt(self._belief.covariance[:, ROLL_BIAS, ROLL_BIAS])
            turns = np.abs(error) > self.settings.rest_turn + 4.0 * spread
            self._leave_rest(there & resting & turns)
        self._correct(time, error, expected.slopes, expected.noise, there)
        there = there & known[:, 1] & known[:, 2]
        expected = self._arithmetic.expected(ImuReadings.YAW_TURN, self._history.at(time))
        self._correct(time, yaw - expected.value, expected.slopes, expected.noise, there)
        there = known[:, 0] & known[:, 3:].all(axis=1)
        expected = self._arithmetic.expected(ImuReadings.SIDE_FORCE, self._history.at(time))
        error = side - expected.value
        self._correct(time, error, expected.slopes, expected.noise, there, self.settings.gate)

    def _take_steer(self, time: float, values: np.ndarray, mask: np.ndarray) -> None:
        steer, state = self.sensors.steer, self._belief.state
        quantum = 2.0 * math.pi / steer.counts if steer.counts > 0 else 0.0
        noise = np.full(self.count, steer.noise**2 + quantum**2 / 12.0 + 1e-8)
        then = self._history.at(time)
        error = values[:, 0] - then[:, STEER] - then[:, OFFSET]
        moving = self._belief.moving > 0.0
        if not moving.all():
            # At rest it may be turned by hand; the angle follows, and the zero is not learned.
            still = mask & ~moving
            state[still, STEER] += error[still]
        self._correct(time, error, self._steer_slopes, noise, mask & moving)
        self._belief.torque[mask] = values[mask, 1]

    def _take_wheel(self, time: float, values: np.ndarray, mask: np.ndarray) -> None:
        wheel = self.sensors.wheel
        speed = values[:, 0]
        starts = mask & self.resting & (np.abs(speed) > self.settings.rest_speed)
        self._leave_rest(starts, speed)
        time -= 0.5 * wheel.average
        spread = 0.01 + 0.5 * wheel.scale * np.abs(speed)
        noise = spread * spread + self._tick**2 / 6.0
        error = speed - self._history.at(time)[:, SPEED]
        moving = self._belief.moving > 0.0
        self._correct(time, error, self._wheel_slopes, noise, mask & moving)

    def _leave_rest(self, mask: np.ndarray, speed: np.ndarray | None = None) -> None:
        """Let resting bicycles ride."""
        if not mask.any():
            return
        s, b = self.settings, self._belief
        b.moving[mask] = 1.0
        for index, spread in (
            (LEAN, math.radians(s.launch_lean)),
            (LEAN_RATE, 0.1),
            (STEER, 0.01),
            (STEER_RATE, 0.1),
            (GUST, self._gust),
            (SPEED, 0.5 if speed is not None else 3.0),
        ):
            b.covariance[mask, index, index] += spread * spread
        if speed is not None:
            b.state[mask, SPEED] = speed[mask]
            change = np.zeros_like(b.state)
            change[mask, SPEED] = speed[mask]
            self._history.correct(-math.inf, change)

    def _take_gnss(self, time: float, values: np.ndarray, mask: np.ndarray) -> None:
        """A fix, and the direction of the velocity."""
        g = self.sensors.gnss
        then = self._history.at(time).copy()
        lean, heading = then[:, LEAN], then[:, HEADING]
        yaw = self._arithmetic.rates(then)[:, 2]
        sine, cosine = np.sin(heading), np.cos(heading)
        ahead, left, height = g.position
        across = left + height * np.sin(lean)
        at_x = then[:, X] - sine * ahead - cosine * across
        at_y = then[:, Y] + cosine * ahead - sine * across
        sideways = ahead * yaw + height * np.cos(lean) * then[:, LEAN_RATE]
        slip = np.arctan2(sideways, np.maximum(then[:, SPEED], 0.5))
        noise = g.noise**2 + g.wander**2 + 1e-6
        for error, axis, per_heading in (
            (values[:, 0] - at_x, 1, -cosine * ahead + sine * across),
            (values[:, 1] - at_y, 2, -sine * ahead - cosine * across),
        ):
            self._correct_course(time, error, axis, per_heading, noise, mask)
        speed = np.hypot(values[:, 2], values[:, 3])
        fast = mask & (speed > 1.0) & ~self.resting
        measured = np.arctan2(-values[:, 2], values[:, 3]) - slip
        error = np.remainder(measured - heading + np.pi, 2.0 * np.pi) - np.pi
        spread = (g.velocity_noise / np.maximum(speed, 0.5)) ** 2 + 0.01**2
        self._correct_course(time, error, 0, 1.0, spread, fast)
        self._belief.state[:, HEADING] = wrapped(self._belief.state[:, HEADING])

    def _correct(
        self,
        time: float,
        error: np.ndarray,
        slopes: np.ndarray,
        noise: np.ndarray,
        mask: np.ndarray,
        gate: float = math.inf,
    ) -> None:
        """Correct all estimates since `time`, s; otherwise as `Arithmetic.correct`."""
        change = self._arithmetic.correct(error, slopes, noise, mask, gate)
        self._history.correct(time, change)

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
        b = self._belief
        p = b.course_covariance
        slopes = np.zeros((self.count, len(COURSE)))
        slopes[:, axis] = 1.0
        if axis != 0:
            slopes[:, 0] = per_heading
        reach = (p[:, :, 0] * slopes[:, 0, None] + p[:, :, 1] * slopes[:, 1, None]) + (
            p[:, :, 2] * slopes[:, 2, None]
        )
        along = reach * slopes
        total = (along[:, 0] + along[:, 1]) + along[:, 2] + noise
        believed = mask & (error * error < self.settings.gate**2 * total)
        inverse = believed / total
        change = np.zeros_like(b.state)
        change[:, HEADING:] = reach * (error * inverse)[:, None]
        b.state[:] += change
        p -= reach[:, :, None] * (reach * inverse[:, None])[:, None, :]
        self._history.correct(time, change)

    def estimate(self, time: float | None = None) -> Estimate:
        """Return the estimate at a time not before the last reading's; None is that time.

        The model goes on alone to there; the filter's own state stays where it is.
        """
        b, now = self._belief, self.time
        state = b.state.copy()
        while time is not None and time - now > 1e-9:
            dt = min(STEP, time - now)
            self._arithmetic.move(state, dt)
            now += dt
        rates = self._arithmetic.rates(state) * b.moving[:, None]
        return Estimate(
            time=now,
            lean_angle=state[:, LEAN],
            lean_rate=state[:, LEAN_RATE],
            lean_acceleration=rates[:, 0],
            steer_angle=state[:, STEER],
            steer_rate=state[:, STEER_RATE],
            heading=state[:, HEADING],
            yaw_rate=rates[:, 2],
            speed=state[:, SPEED],
            x=state[:, X],
            y=state[:, Y],
            biases=state[:, ROLL_BIAS:HEADING],
            covariance=b.covariance.copy(),
            course_covariance=b.course_covariance.copy(),
            calibrated=b.covariance[:, ROLL_BIAS, ROLL_BIAS] < CALIBRATED**2,
        )


def _numbers(s: FilterSettings, sensors: SensorSettings, gust: float) -> Numbers:
    """The equations' numbers.

    Args:
        s: settings of the filter.
        sensors: what is believed of them.
        gust: rad, standard deviation of the lean that pushes as the wind does.
    """
    imu = sensors.imu
    return Numbers(
        roll_noise=s.roll_noise**2,
        torque_noise=s.torque_noise**2,
        gust_noise=2.0 * gust**2 / s.gust_time,
        speed_noise=s.speed_noise**2,
        gyro_walk=imu.gyro_walk**2,
        force_walk=imu.accelerometer_walk**2,
        offset_walk=s.offset_walk**2,
        course_noise=s.course_noise**2,
        gust_decay=1.0 / s.gust_time,
        turn_noise=imu.gyro_noise**2 * imu.rate + imu.gyro_step**2 / 12.0 + 1e-8,
        turn_model=s.model_turn**2,
        force_noise=imu.accelerometer_noise**2 * imu.rate
        + imu.accelerometer_step**2 / 12.0
        + 1e-8,
        force_model=imu.vibration**2 + s.model_force**2,
        ahead=imu.position[0],
        height=imu.position[2],
    )


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
