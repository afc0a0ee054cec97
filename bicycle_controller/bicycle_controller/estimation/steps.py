"""Estimates step by step from readings as they come: the same readings give the same bits.

An estimate at a step uses every reading that has come, in the order of the time stamps. It says of
each sensor the stamp of the last reading that it used and how many were used so far, and which
estimate it is: from these it can be made again, or what a recording lacks for that can be told.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bicycle_controller.estimation.kalman import Filter
from bicycle_controller.estimation.order import InOrder
from bicycle_controller.estimation.settings import FilterSettings
from bicycle_controller.estimation.states import Estimate
from bicycle_controller.estimation.watch import SensorWatch
from bicycle_sim.plants.base import Plant
from bicycle_sim.sensors.reading import ORDER, Reading
from bicycle_sim.sensors.settings import Sampled, SensorSettings

MOST_KEPT = 8000
"""Readings that wait to be used; some 20 s of them."""


@dataclass(frozen=True)
class Used:
    """Readings that an estimate was made from, and its number."""

    stamps: tuple[float, ...]
    """s, of the last readings used, in ORDER."""
    counts: tuple[int, ...] = ()
    """Readings used since the rest began, in ORDER; the first estimator told none."""
    number: int = 0
    """Number of the estimate since the rest, from 1; the first estimator told none."""

    @classmethod
    def of(cls, numbers: Sequence[float]) -> Used:
        """Return what `numbers` gave; it may be the first estimator's stamps.

        Raises:
            ValueError: on other numbers.
        """
        many = len(ORDER)
        if len(numbers) not in (many, 2 * many + 1) or not all(map(math.isfinite, numbers)):
            raise ValueError(f"{len(numbers)} numbers do not tell what an estimate was made from")
        stamps, rest = numbers[:many], [int(one) for one in numbers[many:]]
        return cls(tuple(stamps), tuple(rest[:many]), rest[many] if rest else 0)

    @property
    def numbers(self) -> list[float]:
        """All as plain numbers."""
        return [*self.stamps, *map(float, self.counts), float(self.number)]


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
        self._ignores_stuck = (settings or FilterSettings()).ignores_stuck
        self._watch = SensorWatch(sensors, plant.geometry.wheelbase)
        self._in_order = InOrder()
        self._waiting: list[Reading] = []
        self._batch: list[Reading] = []
        self.last: dict[str, float] = {}
        """Stamp of the last reading that was used, by sensor, s."""
        self.counts: dict[str, int] = {}
        """Readings that were used since `begin`, by sensor."""
        self.number = 0
        """Estimates that were made since `begin`."""

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
        self.counts = dict.fromkeys(ORDER, 0)
        self.number = 0
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
        """Take a reading that has come, unless a newer one has overtaken it."""
        if self._in_order.begins_anew(reading):
            self._waiting = [one for one in self._waiting if one.sensor != reading.sensor]
        if self._in_order.takes(reading):
            self._waiting.append(reading)
            del self._waiting[:-MOST_KEPT]

    def waiting(self) -> list[Reading]:
        """Return the readings that no estimate has used yet, in the order in which they came."""
        return list(self._waiting)

    def step(self, time: float) -> Estimate:
        """The estimate at a time of the sensors' clock, s, from all that has come."""
        self.number += 1
        self._batch, self._waiting = self._waiting, []
        for reading in sorted(self._batch, key=lambda one: (one.stamp, ORDER.index(one.sensor))):
            if reading.stamp <= self.last.get(reading.sensor, -1e18):
                continue
            self.last[reading.sensor] = reading.stamp
            self.counts[reading.sensor] = self.counts.get(reading.sensor, 0) + 1
            bias = float(self._filter.yaw_bias[0]) if reading.sensor == "imu" else 0.0
            self._watch.take(reading, max(time, reading.stamp), bias)
            if not (self._ignores_stuck and self._watch.stuck(reading.sensor)):
                self._filter.take(reading)
        return self._filter.estimate(time)

    def take_back(self) -> None:
        """Let the readings of the last estimate wait again, as if it had not been made.

        Only what was published is in a bag: an estimate that nobody hears must leave no trace.
        """
        self._waiting = self._batch + self._waiting
        self._batch = []

    def problems(self, time: float) -> tuple[str, ...]:
        """Return the sensors' problems, one text each."""
        return self._watch.problems(time)

    @property
    def used(self) -> Used:
        """Readings of the last estimate, and its number."""
        return Used(
            tuple(self.last.get(name, -1e18) for name in ORDER),
            tuple(self.counts.get(name, 0) for name in ORDER),
            self.number,
        )


def replayed(
    estimator: StepEstimator, readings: Iterable[Reading], used: Used, time: float
) -> Estimate:
    """The estimate that used exactly the readings up to the stamps in `used`.

    Args:
        estimator: after the estimate before.
        readings: of a recording, each sensor's in its topic's order.
        used: of the estimate.
        time: the estimate's time.
    """
    for reading in readings:
        index = ORDER.index(reading.sensor)
        if estimator.last.get(reading.sensor, -1e18) < reading.stamp <= used.stamps[index]:
            estimator.add(reading)
    return estimator.step(time)
