"""Estimates step by step from readings as they come: the same readings give the same bits.

An estimate at a step uses every reading that has come, in the order of the time stamps; it says of
each sensor the last stamp that it used, from which `replayed` makes it again.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from bicycle_controller.estimation.kalman import Filter
from bicycle_controller.estimation.settings import FilterSettings
from bicycle_controller.estimation.states import Estimate
from bicycle_controller.estimation.watch import SensorWatch
from bicycle_sim.plants.base import Plant
from bicycle_sim.sensors.reading import ORDER, Reading
from bicycle_sim.sensors.settings import Sampled, SensorSettings


class StepEstimator:
    """The estimates of one bicycle."""

    def __init__(
        self, plant: Plant[Any], sensors: SensorSettings, settings: FilterSettings | None = None
    ) -> None:
        """Begin before any reading.

        Args:
            plant: the bicycle.
            sensors: what its sensors are like.
            settings: of the filter; None is today's.
        """
        self.sensors = sensors
        self._filter = Filter(plant, sensors, 1, settings)
        self._watch = SensorWatch(sensors, plant.geometry.wheelbase)
        self._waiting: list[Reading] = []
        self.last: dict[str, float] = {}
        """Stamp of the last reading that was used, by sensor, s."""

    def begin(self, time: float, x: float, y: float, heading: float) -> None:
        """Forget all before the rest that ends at `time`, s of the sensors' clock.

        Args:
            time: of the first step.
            x: m, where the rear contact stands.
            y: m.
            heading: rad.
        """
        begun = time - self.sensors.rest
        self._filter.restart(begun)
        self._filter.place(*(np.array([float(value)]) for value in (x, y, heading)))
        self._watch = SensorWatch(self.sensors, self._watch.wheelbase)
        self.last = dict.fromkeys(ORDER, begun - 1e-6)
        self._waiting = [one for one in self._waiting if one.stamp > begun - 1e-6]

    def lacking(self, time: float) -> tuple[str, ...]:
        """Return the sensors whose readings until `time` (s) are not all in."""
        found = []
        for name in ORDER:
            timing: Sampled = getattr(self.sensors, name)
            newest = max((one.stamp for one in self._waiting if one.sensor == name), default=-1e18)
            if timing.rate > 0.0 and newest < time - timing.latency - 0.05 - 5.0 / timing.rate:
                found.append(name)
        return tuple(found)

    def add(self, reading: Reading) -> None:
        """Take a reading that has come."""
        self._waiting.append(reading)

    def step(self, time: float) -> Estimate:
        """The estimate at a time of the sensors' clock, s, from all that has come."""
        batch = sorted(self._waiting, key=lambda one: (one.stamp, ORDER.index(one.sensor)))
        self._waiting = []
        for reading in batch:
            if reading.stamp <= self.last.get(reading.sensor, -1e18):
                continue
            self.last[reading.sensor] = reading.stamp
            self._filter.take(reading)
            bias = float(self._filter.yaw_bias[0]) if reading.sensor == "imu" else 0.0
            self._watch.take(reading, max(time, reading.stamp), bias)
        return self._filter.estimate(time)

    def problems(self, time: float) -> tuple[str, ...]:
        """Return the sensors' problems, one text each."""
        return self._watch.problems(time)

    @property
    def used(self) -> list[float]:
        """Stamps of the last readings used, in ORDER, s; what `replayed` needs."""
        return [self.last.get(name, -1e18) for name in ORDER]


def replayed(
    estimator: StepEstimator, readings: Iterable[Reading], used: list[float], time: float
) -> Estimate:
    """The estimate that used exactly the readings up to the stamps `used`, in ORDER.

    Args:
        estimator: after the estimate before.
        readings: of a recording, in any order.
        used: of the estimate.
        time: the estimate's time.
    """
    for reading in readings:
        index = ORDER.index(reading.sensor)
        if estimator.last.get(reading.sensor, -1e18) < reading.stamp <= used[index]:
            estimator.add(reading)
    return estimator.step(time)
