"""The sensors of N bicycles: from true motion to readings, each with its own clock and errors.

Each sensor draws from a generator of its own, the same number of values at each reading, so that
one sensor's settings change no other's noise and the same seed gives the same readings.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from bicycle_sim.plants.base import BodyState, Plant
from bicycle_sim.sensors import kinematics
from bicycle_sim.sensors.kinematics import Motion
from bicycle_sim.sensors.reading import ORDER, Reading
from bicycle_sim.sensors.settings import (
    GnssSettings,
    ImuSettings,
    Sampled,
    SensorSettings,
    SteerSettings,
    WheelSettings,
)

GRAVITY = 9.81
"""m/s^2."""

TOLERANCE = 1e-9
"""s within which two times are the same."""


class SensorSuite:
    """Sensors on N bicycles of one plant."""

    def __init__(
        self, settings: SensorSettings, plant: Plant[Any], count: int, seed: int = 0
    ) -> None:
        """Mount the sensors.

        Args:
            settings: of the sensors.
            plant: the bicycles they are on.
            count: N.
            seed: of all noise; not negative.
        """
        self.settings = settings
        self.plant = plant
        self.count = count
        radius = plant.geometry.rear_radius
        self._sensors: dict[str, _Sensor] = {}
        for index, name in enumerate(ORDER):
            rng = np.random.Generator(np.random.PCG64([seed, 1000 + index]))
            sensor = _create(getattr(settings, name), count, rng, radius)
            if sensor is not None:
                self._sensors[name] = sensor
        self.time = 0.0
        """s of the sensors' clock."""
        self._last: Motion | None = None

    def begin(self, state: BodyState) -> None:
        """Take a state that follows no other, as after a start or a push."""
        now = kinematics.motion(self.plant, state, np.zeros(self.count))
        self._begin(now)

    def rest(self, state: BodyState, duration: float | None = None) -> list[Reading]:
        """Stand still, held upright, before a ride that begins with `state`.

        Args:
            state: of the start; it is begun with, see `begin`.
            duration: s; None is the settings' `rest`.

        Returns:
            The readings.
        """
        moving = kinematics.motion(self.plant, state, np.zeros(self.count))
        still = kinematics.standing(moving)
        self._begin(still)
        span = self.settings.rest if duration is None else duration
        found: list[Reading] = []
        steps = math.ceil(span / 0.01 - 1e-9)
        for _ in range(steps):
            found += self._advance(still, span / steps)
        self._begin(moving)
        return found

    def advance(
        self, trace: list[Any], period: float, torque: np.ndarray | None = None
    ) -> list[Reading]:
        """Measure during one control period.

        Args:
            trace: states at equal intervals within it, as `Plant.trace` gives them.
            period: s.
            torque: (N,) N m commanded, for plants without a motor.

        Returns:
            What is measured in the period, in the order of the time stamps; it may arrive later.
        """
        commanded = np.zeros(self.count) if torque is None else torque
        found: list[Reading] = []
        for state in trace:
            now = kinematics.motion(self.plant, state, commanded)
            found += self._advance(now, period / len(trace))
        return found

    def _begin(self, now: Motion) -> None:
        self._last = now
        for sensor in self._sensors.values():
            sensor.begin(now)

    def _advance(self, now: Motion, duration: float) -> list[Reading]:
        if self._last is None:
            raise ValueError("the sensors need a state to begin with: call begin first")
        ended = self.time + duration
        found: list[Reading] = []
        for sensor in self._sensors.values():
            sensor.follow(self._last, now, self.time, duration)
            due = sensor.next_instant
            while due <= ended + TOLERANCE:
                share = min(max((due - self.time) / duration, 0.0), 1.0)
                found.append(sensor.read(kinematics.blend(self._last, now, share), due))
                due = sensor.next_instant
        self.time, self._last = ended, now
        return sorted(found, key=lambda reading: (reading.stamp, ORDER.index(reading.sensor)))


class _Sensor:
    """One kind of sensor on N bicycles."""

    name = ""
    quantities = 1

    def __init__(self, settings: Sampled, count: int, rng: np.random.Generator) -> None:
        self._timing = settings
        self._count = count
        self._rng = rng
        self._index = 0
        self._held: np.ndarray | None = None

    @property
    def next_instant(self) -> float:
        """s at which the next reading is measured, before its time stamp by its age."""
        return (self._index + 1) / self._timing.rate - self._timing.age

    def begin(self, now: Motion) -> None:
        """Take a motion that follows no other."""

    def follow(self, before: Motion, now: Motion, time: float, duration: float) -> None:
        """Take what happened since the last motion."""

    def read(self, now: Motion, instant: float) -> Reading:
        """Return the reading of that motion."""
        timing = self._timing
        stamp = (self._index + 1) / timing.rate
        self._index += 1
        values = self._measure(now, instant)
        luck, wait = self._rng.random(self._count), self._rng.standard_normal(self._count)
        if stamp >= timing.stuck_from and self._held is not None:
            values = self._held
        self._held = values
        lost = (luck < timing.dropout) | (stamp >= timing.gone_from)
        arrival = stamp + timing.latency + timing.jitter * np.abs(wait)
        return Reading(self.name, stamp, arrival, lost, values)

    def _measure(self, now: Motion, instant: float) -> np.ndarray:
        raise NotImplementedError


def _to_step(values: np.ndarray, step: float) -> np.ndarray:
    """Round values to whole steps; a step of zero leaves them."""
    return step * np.rint(values / step) if step > 0.0 else values


class _Imu(_Sensor):
    name = "imu"

    def __init__(
        self, settings: ImuSettings, count: int, rng: np.random.Generator, radius: float
    ) -> None:
        super().__init__(settings, count, rng)
        self._s = settings
        self._radius = radius
        self._point = np.array(settings.position)
        draws = rng.standard_normal((count, 9))
        self.gyro_bias = settings.gyro_bias * draws[:, :3]
        self.force_bias = settings.accelerometer_bias * draws[:, 3:6]
        askew = np.radians(settings.misalignment) * draws[:, 6:9]
        mounted = turned(np.radians(np.array(settings.mounting)))
        self._axes = mounted @ turned(askew)
        self._turn = np.zeros((count, 3))
        self._force = np.zeros((count, 3))
        self._velocity: np.ndarray | None = None

    def begin(self, now: Motion) -> None:
        self._take(now, np.zeros(self._count), None)

    def follow(self, before: Motion, now: Motion, time: float, duration: float) -> None:
        self._take(now, (now.pitch - before.pitch) / duration, duration)

    def _take(self, now: Motion, pitch_rate: np.ndarray, duration: float | None) -> None:
        """Turning and specific force of the frame at the sensor, in the frame's axes."""
        axes = kinematics.frame_axes(now)
        self._turn = kinematics.turning(now, pitch_rate)
        velocity = kinematics.point_velocity(now, axes, self._turn, self._point, self._radius)
        felt = np.zeros_like(velocity)
        if duration is not None and self._velocity is not None:
            felt = (velocity - self._velocity) / duration
        felt[:, 0] -= now.yaw_rate * velocity[:, 1]
        felt[:, 1] += now.yaw_rate * velocity[:, 0]
        felt[:, 2] += GRAVITY
        self._force = np.einsum("nji,nj->ni", axes, felt)
        self._velocity = velocity

    def _measure(self, now: Motion, instant: float) -> np.ndarray:
        s, rng = self._s, self._rng
        noise, walk = rng.standard_normal((self._count, 6)), rng.standard_normal((self._count, 6))
        step = np.sqrt(1.0 / s.rate)
        self.gyro_bias = self.gyro_bias + s.gyro_walk * step * walk[:, :3]
        self.force_bias = self.force_bias + s.accelerometer_walk * step * walk[:, 3:]
        turn = np.einsum("nji,nj->ni", self._axes, self._turn)
        force = np.einsum("nji,nj->ni", self._axes, self._force)
        shakes = s.vibration * np.minimum(np.abs(now.speed), 1.0)[:, None]
        spread = np.hypot(s.accelerometer_noise / step, shakes)
        turn = turn + self.gyro_bias + (s.gyro_noise / step) * noise[:, :3]
        force = force + self.force_bias + spread * noise[:, 3:]
        turn = _to_step(np.clip(turn, -s.gyro_range, s.gyro_range), s.gyro_step)
        most = s.accelerometer_range
        force = _to_step(np.clip(force, -most, most), s.accelerometer_step)
        return np.concatenate([turn, force], axis=1)


def turned(angles: np.ndarray) -> np.ndarray:
    """Return the axes (..., 3, 3) of a frame with roll, pitch and yaw (..., 3) as columns."""
    s, c = np.sin(angles), np.cos(angles)
    (sr, sp, sy), (cr, cp, cy) = np.moveaxis(s, -1, 0), np.moveaxis(c, -1, 0)
    rows = (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )
    return np.stack([np.stack(row, -1) for row in rows], -2)


class _Steer(_Sensor):
    name = "steer"

    def __init__(self, settings: SteerSettings, count: int, rng: np.random.Generator) -> None:
        super().__init__(settings, count, rng)
        self._s = settings
        self._offset = settings.offset * rng.standard_normal(count)

    def _measure(self, now: Motion, instant: float) -> np.ndarray:
        noise = self._rng.standard_normal((self._count, 2))
        step = 2.0 * np.pi / self._s.counts if self._s.counts > 0 else 0.0
        angle = now.steer + self._offset + self._s.noise * noise[:, 0]
        torque = now.steer_torque + self._s.torque_noise * noise[:, 1]
        return np.stack([_to_step(angle, step), torque], axis=1)


class _Wheel(_Sensor):
    name = "wheel"

    def __init__(
        self, settings: WheelSettings, count: int, rng: np.random.Generator, radius: float
    ) -> None:
        super().__init__(settings, count, rng)
        self._s = settings
        self._step = 2.0 * np.pi * max(radius, 0.01) / settings.ticks if settings.ticks else 0.0
        self._scale = 1.0 + settings.scale * rng.standard_normal(count)
        self._rolled = np.zeros(count)
        self._before, self._now, self._begun, self._lasts = self._rolled, self._rolled, 0.0, 0.0
        self._kept: list[np.ndarray] = []

    def begin(self, now: Motion) -> None:
        # As if it had always rolled so fast: a start is no acceleration from rest.
        span = 1.0 / self._s.rate
        self._kept = [self._rolled - now.speed * span * age for age in range(self._periods, 0, -1)]

    @property
    def _periods(self) -> int:
        """Readings between the two that a speed is the difference of."""
        return max(1, round(self._s.average * self._s.rate))

    def follow(self, before: Motion, now: Motion, time: float, duration: float) -> None:
        self._before = self._rolled
        self._rolled = self._rolled + 0.5 * (before.speed + now.speed) * duration
        self._begun, self._lasts = time, duration

    def _measure(self, now: Motion, instant: float) -> np.ndarray:
        share = min(max((instant - self._begun) / self._lasts, 0.0), 1.0)
        place = (1.0 - share) * self._before + share * self._rolled
        if self._s.average <= 0.0:
            return (now.speed * self._scale)[:, None]
        self._kept.append(place)
        periods = self._periods
        old = self._kept[-1 - periods] if len(self._kept) > periods else self._kept[0]
        self._kept = self._kept[-periods - 1 :]
        moved = place - old
        if self._step > 0.0:
            moved = self._step * (np.floor(place / self._step) - np.floor(old / self._step))
        return (moved * self._scale / (periods / self._s.rate))[:, None]


class _Gnss(_Sensor):
    name = "gnss"

    def __init__(
        self, settings: GnssSettings, count: int, rng: np.random.Generator, radius: float
    ) -> None:
        super().__init__(settings, count, rng)
        self._s = settings
        self._radius = radius
        self._wander = settings.wander * rng.standard_normal((count, 2))

    def _measure(self, now: Motion, instant: float) -> np.ndarray:
        s = self._s
        draws = self._rng.standard_normal((self._count, 6))
        keep = float(np.exp(-1.0 / (s.rate * max(s.wander_time, 1e-3))))
        fresh = s.wander * np.sqrt(1.0 - keep * keep)
        self._wander = keep * self._wander + fresh * draws[:, :2]
        x, y = kinematics.point_place(now, np.array(s.position), self._radius)
        place = np.stack([x, y], 1) + self._wander + s.noise * draws[:, 2:4]
        ahead = np.stack([-np.sin(now.heading), np.cos(now.heading)], 1)
        left = np.stack([-np.cos(now.heading), -np.sin(now.heading)], 1)
        height = s.position[2]
        sideways = s.position[0] * now.yaw_rate + height * np.cos(now.lean) * now.lean_rate
        velocity = now.speed[:, None] * ahead + sideways[:, None] * left
        return np.concatenate([place, velocity + s.velocity_noise * draws[:, 4:6]], axis=1)


def _create(
    settings: Sampled, count: int, rng: np.random.Generator, radius: float
) -> _Sensor | None:
    """Return the sensors with these settings on N bicycles; None where there are none."""
    if settings.rate <= 0.0:
        return None
    match settings:
        case ImuSettings():
            return _Imu(settings, count, rng, radius)
        case SteerSettings():
            return _Steer(settings, count, rng)
        case WheelSettings():
            return _Wheel(settings, count, rng, radius)
        case GnssSettings():
            return _Gnss(settings, count, rng, radius)
    raise TypeError(f"no sensor has {type(settings).__name__}")
