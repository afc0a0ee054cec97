"""Watches one bicycle's sensors: says which of them are gone, late or stuck, and since when."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from bicycle_sim.sensors.reading import ORDER, Reading
from bicycle_sim.sensors.settings import Sampled, SensorSettings
from bicycle_sim.sensors.suite import turned

GONE_PERIODS = 10.0
"""Periods of silence after which a sensor is gone; so many and GONE_LEAST s."""
GONE_LEAST = 0.1
"""s."""
LATE = 0.05
"""s beyond its usual latency from which on readings are late."""
STUCK_READINGS = {"imu": 5, "gnss": 3}
"""Readings in a row that are equal to the last digit, though the sensor has noise."""
STUCK_TIME = 0.5
"""s without any change of an encoder that the gyros contradict."""
STUCK_STEER = 0.06
"""rad that the steering must have turned meanwhile, by the yaw gyro."""
STUCK_SPEED = 1.0
"""m/s that the speed must have changed meanwhile, by the accelerometer."""
ROLLING = 0.5
"""m/s from which on a turn of the frame is one of the steering, and a place changes."""
FELT_ALWAYS = 10.0
"""s over which a mean of the accelerometer counts as its bias, and as the slope of the road."""


@dataclass
class _Last:
    """Last message of a sensor."""

    stamp: float = -math.inf
    arrival: float = -math.inf
    late: float = 0.0
    values: np.ndarray | None = None
    changed: float = -math.inf
    """Stamp of the last change of its values."""
    repeats: int = 0
    extremes: tuple[float, float] = (0.0, 0.0)
    """Extremes of the readings that contradict a standstill, since the last change."""
    problem: str = ""
    since: float = 0.0


@dataclass
class SensorWatch:
    """The state of one bicycle's sensors."""

    settings: SensorSettings
    wheelbase: float
    """m, which makes a steering angle of a yaw rate."""
    _lasts: dict[str, _Last] = field(default_factory=dict)
    _speed: float = 0.0
    _gained: float = 0.0
    """m/s that the accelerometer along the bicycle has added up, less what it feels always."""
    _always: float = math.nan
    """m/s^2 that it feels always."""
    _axes: np.ndarray = field(init=False)
    """(3, 3), from the IMU's axes to the frame's."""

    def __post_init__(self) -> None:
        self._axes = turned(np.radians(np.array(self.settings.imu.mounting)))

    def take(self, reading: Reading, arrival: float, yaw_bias: float = 0.0) -> None:
        """Look at a reading.

        Args:
            reading: of one bicycle.
            arrival: s of the sensors' clock at which it came.
            yaw_bias: rad/s, of the yaw gyro, as far as it is known.
        """
        last = self._lasts.setdefault(reading.sensor, _Last())
        values = reading.values[0]
        last.late = arrival - reading.stamp - getattr(self.settings, reading.sensor).latency
        last.arrival = arrival
        same = last.values is not None and np.array_equal(values, last.values, equal_nan=True)
        if reading.sensor == "steer" and last.values is not None:
            same = bool(values[0] == last.values[0])
        if not same:
            last.changed, last.repeats, last.extremes = reading.stamp, 0, (math.inf, -math.inf)
        else:
            last.repeats += 1
        gap = reading.stamp - last.stamp
        last.stamp, last.values = reading.stamp, values
        if reading.sensor == "wheel":
            self._speed = float(values[0])
        if reading.sensor == "imu" and math.isfinite(gap) and not self._is_stuck("imu", last):
            self._contradict(values, yaw_bias, gap)

    def stuck(self, name: str) -> bool:
        """Return True if a sensor's last reading shows that it is stuck."""
        last = self._lasts.get(name)
        return last is not None and self._is_stuck(name, last)

    def _contradict(self, values: np.ndarray, yaw_bias: float, gap: float) -> None:
        """Judge unchanging encoders by an IMU's reading."""
        turn, force = self._axes @ values[:3], self._axes @ values[3:]
        forward, step = float(force[0]), min(gap, 0.1)
        if not math.isfinite(self._always):
            self._always = forward
        self._always += (forward - self._always) * step / FELT_ALWAYS
        self._gained += (forward - self._always) * step
        speed = abs(self._speed)
        found = {"wheel": self._gained}
        if speed >= ROLLING:
            found["steer"] = math.atan((float(turn[2]) - yaw_bias) * self.wheelbase / speed)
        for name, value in found.items():
            last = self._lasts.get(name)
            if last is not None and last.repeats > 0 and math.isfinite(value):
                low, high = last.extremes
                last.extremes = min(low, value), max(high, value)

    def problems(self, now: float) -> tuple[str, ...]:
        """Return the faults at `now`, s of the sensors' clock, one text a sensor, in order."""
        found = []
        for name in ORDER:
            timing: Sampled = getattr(self.settings, name)
            if timing.rate <= 0.0:
                continue
            last = self._lasts.setdefault(name, _Last())
            problem, since = self._problem(name, last, timing, now)
            if problem != last.problem:
                last.problem, last.since = problem, since
            if problem:
                found.append(f"{name} {problem} since {last.since:.2f} s")
        return tuple(found)

    def _should_change(self, name: str) -> bool:
        """Return True if a healthy sensor's readings differ now."""
        imu, gnss = self.settings.imu, self.settings.gnss
        if name == "gnss":
            return gnss.noise > 0.0 or abs(self._speed) >= ROLLING
        if imu.gyro_noise > 0.0 or imu.accelerometer_noise > 0.0:
            return True
        # A simulated one without noise repeats itself while the bicycle goes straight on.
        since = self._lasts["imu"].changed + STUCK_READINGS["imu"] / imu.rate
        return self._lasts.get("steer", _Last()).changed > since

    def _problem(self, name: str, last: _Last, timing: Sampled, now: float) -> tuple[str, float]:
        """Return a word for a sensor's fault, and its begin."""
        patience = max(GONE_PERIODS / timing.rate, GONE_LEAST) + timing.latency
        if now - max(last.arrival, 0.0) > patience:
            return "gone", max(last.arrival, 0.0)
        if last.late > LATE + 5.0 * timing.jitter:
            return "late", now
        if self._is_stuck(name, last):
            return "stuck", last.changed
        return "", now

    def _is_stuck(self, name: str, last: _Last) -> bool:
        if name in STUCK_READINGS:
            return last.repeats >= STUCK_READINGS[name] and self._should_change(name)
        low, high = last.extremes
        most = STUCK_STEER if name == "steer" else STUCK_SPEED
        return last.stamp - last.changed > STUCK_TIME and high - low > most
