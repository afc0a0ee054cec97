"""Estimates step by step: the readings that they used, and the same bits from these."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from bicycle_controller.control.lqr import LqrController
from bicycle_controller.estimation.queue import Arrivals
from bicycle_controller.estimation.settings import ESTIMATOR, of_estimator
from bicycle_controller.estimation.steps import StepEstimator, Used, replayed
from bicycle_sim.plants import registry
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.sensors import settings
from bicycle_sim.sensors.reading import ORDER, Reading
from bicycle_sim.sensors.suite import SensorSuite
from bicycle_sim.task.scenario import named

SENSORS = settings.load("mpu6050-rtk")
PLANT = registry.default()


@pytest.fixture(scope="module")
def rest() -> tuple[float, list[Reading]]:
    """The time at the end of a rest, and its readings."""
    simulator = Simulator(named("random-start-random-goal"), PLANT, 1, SENSORS)
    simulator.reset()
    return simulator.sensor_time, simulator.readings


def begun(time: float, readings: list[Reading]) -> StepEstimator:
    steps = StepEstimator(PLANT, SENSORS)
    for reading in readings:
        steps.add(reading)
    steps.begin(time, 0.0, 0.0, 0.0)
    return steps


def test_it_tells_what_it_used(rest: tuple[float, list[Reading]]) -> None:
    time, readings = rest
    steps = begun(time, readings)
    steps.step(time)
    for index, sensor in enumerate(ORDER):
        mine = [one.stamp for one in readings if one.sensor == sensor]
        assert len(mine) > 10
        assert steps.used.counts[index] == len(mine)
        assert steps.used.stamps[index] == mine[-1]
    assert steps.used.number == 1
    assert Used.of(steps.used.numbers) == steps.used


def test_the_first_estimator_told_stamps_only() -> None:
    assert Used.of([1.0, 2.0, 3.0, 4.0]) == Used((1.0, 2.0, 3.0, 4.0), (), 0)


@pytest.mark.parametrize("numbers", [[], [1.0] * 8, [1.0] * 8 + [math.nan]])
def test_other_numbers_are_refused(numbers: list[float]) -> None:
    with pytest.raises(ValueError, match="do not tell what an estimate was made from"):
        Used.of(numbers)


def test_the_order_of_the_topics_does_not_matter(rest: tuple[float, list[Reading]]) -> None:
    time, readings = rest
    one, other = begun(time, readings), begun(time, sorted(readings, key=lambda r: r.sensor))
    found, again = one.step(time), other.step(time)
    assert one.used == other.used
    np.testing.assert_array_equal(found.x, again.x)
    np.testing.assert_array_equal(found.covariance, again.covariance)


def test_an_estimate_that_was_taken_back_leaves_no_trace(
    rest: tuple[float, list[Reading]],
) -> None:
    """An estimate that was not published is not in a bag: the next comes out without it."""
    time, readings = rest
    late = [one for one in readings if one.sensor == "gnss" and one.stamp > 2.0]
    early = [one for one in readings if not any(one is other for other in late)]
    steps = begun(time, early)
    steps.step(time)
    steps.take_back()
    for reading in late:
        steps.add(reading)
    steps.begin(time, 0.0, 0.0, 0.0)
    found = steps.step(time)
    again = begun(time, [])
    expected = replayed(again, readings, steps.used, time)
    assert steps.used == again.used
    np.testing.assert_array_equal(found.x, expected.x)
    np.testing.assert_array_equal(found.course_covariance, expected.course_covariance)


def largest_lean(sensor: str, fault: str, estimator: int = ESTIMATOR) -> tuple[float, str]:
    """Return the largest lean, rad, of 8 s by estimates, whose sensor fails after 2 s; the words.

    The bicycle follows a heading to and fro, so that its sensors have something to tell.
    """
    plant = registry.named("whipple", "rigid-rider")
    who = LqrController.named("lqr", plant, 7.0)
    data = SENSORS.to_dict()
    data[sensor] = {**data[sensor], fault: SENSORS.rest + 2.0}
    suite, arrivals = SensorSuite(settings.from_dict(data), plant, 1, 4), Arrivals()
    steps = StepEstimator(plant, SENSORS, of_estimator(estimator))
    zero, largest, told = np.zeros(1), 0.0, ""
    state: Any = plant.initial(zero, zero, zero, np.array([4.0]))
    arrivals.add(suite.rest(state))
    suite.begin(state)
    steps.begin(suite.time, 0.0, 0.0, 0.0)
    for index in range(320):
        for reading, _ in arrivals.due(suite.time):
            steps.add(reading)
        found = steps.step(suite.time)
        told = told or ", ".join(steps.problems(suite.time))
        o = (found.steer_angle, found.steer_rate, found.lean_angle, found.lean_rate)
        wanted = 0.3 * math.sin(0.015 * index)
        seen = np.array([*o, found.lean_acceleration, found.heading - wanted]).T
        trace = plant.trace(state, who.act(seen, found.speed)[:, 0], zero, zero)
        arrivals.add(suite.advance(trace, plant.time_step))
        state = trace[-1]
        largest = max(largest, abs(float(state.lean_angle[0])))
    return largest, told.partition(" since")[0]


@pytest.mark.parametrize("sensor", ["imu", "steer", "gnss"])
def test_a_sensor_that_is_stuck_does_not_fell_the_bicycle(sensor: str) -> None:
    largest, told = largest_lean(sensor, "stuck_from")
    assert told == f"{sensor} stuck"
    assert largest < math.radians(30.0)


@pytest.mark.parametrize("sensor", ["imu", "steer", "wheel", "gnss"])
def test_a_sensor_that_is_gone_does_not_fell_the_bicycle(sensor: str) -> None:
    largest, told = largest_lean(sensor, "gone_from")
    assert told == f"{sensor} gone"
    assert largest < math.radians(30.0)


def test_earlier_estimators_believed_a_stuck_sensor() -> None:
    """Their bags are verified with what they did."""
    assert largest_lean("imu", "stuck_from", 2)[0] > math.radians(45.0)
    assert [of_estimator(one).ignores_stuck for one in (1, 2, 3)] == [False, False, True]
    assert [of_estimator(one).gust_force for one in (1, 2, 3)] == [0.0, 3.0, 3.0]
