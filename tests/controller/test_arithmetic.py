"""The filter's equations: compiled and in numpy, the same bits, for one bicycle and for many."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from whipple_maker import various

from bicycle_controller.estimation import native
from bicycle_controller.estimation.kalman import Filter
from bicycle_controller.estimation.queue import Arrivals
from bicycle_controller.estimation.states import STATES
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Loads, Plant
from bicycle_sim.plants.whipple.plant import WhipplePlant
from bicycle_sim.sensors import settings as sensors
from bicycle_sim.sensors.suite import SensorSuite

PERIOD = 0.025


def ride(plant: Plant[Any], preset: str, count: int, filters: list[Filter], steps: int) -> None:
    """Let filters follow N rides under random torques, and wind if the plant has it."""
    suite, arrivals = SensorSuite(sensors.load(preset), plant, count, 4), Arrivals()
    rng = np.random.default_rng(8)
    zero = np.zeros(count)
    state = plant.initial(zero, zero, zero, rng.uniform(3.0, 6.0, count))
    arrivals.add(suite.rest(state))
    suite.begin(state)
    for _ in range(steps):
        for reading, mask in arrivals.due(suite.time):
            for one in filters:
                one.take(reading, mask)
        torque = 0.3 * rng.standard_normal(count)
        wind = Loads(lateral_force=zero + 3.0) if isinstance(plant, WhipplePlant) else None
        trace = plant.trace(state, torque, zero, zero, None, wind)
        arrivals.add(suite.advance(trace, PERIOD))
        state = trace[-1]


def same_bits(plant: Plant[Any], preset: str, count: int) -> None:
    given = sensors.load(preset)
    filters = [Filter(plant, given, count, compiled=compiled) for compiled in (True, False)]
    ride(plant, preset, count, filters, 60)
    assert not filters[0].resting.any()
    for time in (None, filters[0].time + 0.034):
        compiled, plain = (vars(one.estimate(time)) for one in filters)
        for name, value in compiled.items():
            assert np.asarray(value).tobytes() == np.asarray(plain[name]).tobytes(), name


@pytest.mark.parametrize("preset", ["mpu6050-rtk", "rough", "perfect"])
def test_compiled_and_numpy_give_the_same_bits(preset: str) -> None:
    assert native.load() is not None, "set-up has not built it"
    plant = registry.named("whipple", "steer-by-wire").with_actuation(0.0, 7.0, 0.03, 0.0, 0.5)
    same_bits(plant, preset, 3)


def test_so_they_do_for_bicycles_that_differ() -> None:
    same_bits(WhipplePlant(various(5, 1, plain=True)), "mpu6050", 5)


def test_so_they_do_for_the_paper_s_bicycle() -> None:
    same_bits(registry.default(), "mpu6050", 1)


def test_the_place_among_others_does_not_matter() -> None:
    """One of three bicycles is estimated as it is alone."""
    plant, given = registry.named("whipple", "benchmark"), sensors.load("mpu6050")
    three, alone = Filter(plant, given, 3), Filter(plant, given)
    suite = SensorSuite(given, plant, 3, 4)
    zero = np.zeros(3)
    state = plant.initial(zero, zero, zero, np.full(3, 4.0))
    for reading in suite.rest(state):
        three.take(reading)
        mine = type(reading)(
            reading.sensor, reading.stamp, reading.arrival[1:2], reading.lost[1:2],
            reading.values[1:2],
        )  # fmt: skip
        alone.take(mine)
    for name in ("biases", "covariance", "lean_angle"):
        both = (getattr(one.estimate(), name) for one in (three, alone))
        assert np.array_equal(next(both)[1:2], next(both)), name


def test_a_covariance_stays_one() -> None:
    plant, given = registry.named("whipple", "benchmark"), sensors.load("mpu6050")
    one = Filter(plant, given, 2)
    ride(plant, "mpu6050", 2, [one], 200)
    p = one.estimate().covariance
    assert p.shape == (2, len(STATES), len(STATES))
    assert np.allclose(p, p.transpose(0, 2, 1), rtol=1e-9, atol=1e-15)
    assert np.all(np.linalg.eigvalsh(p) > 0.0)
