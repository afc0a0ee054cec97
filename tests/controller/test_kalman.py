"""The filter: its errors over rides, what it is told late, and what it must not believe."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bicycle_controller.control.lqr import LqrConfig, LqrController
from bicycle_controller.estimation.kalman import Filter, as_body
from bicycle_controller.estimation.queue import Arrivals
from bicycle_controller.estimation.states import LEAN
from bicycle_controller.evaluation import sensing
from bicycle_sim.plants import registry
from bicycle_sim.sensors import settings as sensors
from bicycle_sim.sensors.reading import Reading
from bicycle_sim.sensors.suite import GRAVITY, SensorSuite

PERIOD = 0.025


def controller(bicycle: str) -> tuple[LqrController, Any]:
    plant = registry.named("whipple", bicycle)
    return LqrController(LqrConfig(torque_limit=7.0), plant), plant


@pytest.mark.parametrize("bicycle", ["browser-rider", "steer-by-wire"])
def test_lean_is_known_to_half_a_degree_at_2_to_6_m_s(bicycle: str) -> None:
    who, plant = controller(bicycle)
    given = sensing.Conditions(sensors=sensors.load("mpu6050"), duration=8.0)
    assert given.sensors is not None
    assert given.sensors.imu.gyro_bias == 0.05
    assert given.sensors.rest == 5.0
    found = sensing.ride(who, plant, given, 80, seed=11).summary()
    assert found["falls"] == 0
    assert found["roll_error_rms_deg"] <= 0.5
    assert found["roll_error_mean_p95_deg"] <= 0.3


def test_wind_is_told_from_lean() -> None:
    """Gusts push the lightest of the measured bicycles as a degree of lean would."""
    who, plant = controller("steer-by-wire")
    given = sensing.Conditions(sensors=sensors.load("mpu6050"), wind=2.0, duration=10.0)
    found = sensing.ride(who, plant, given, 60, seed=21).summary()
    assert found["falls"] == 0
    assert found["roll_error_rms_deg"] <= 0.3
    assert found["roll_error_mean_deg"] <= 0.22


def test_perfect_sensors_leave_hardly_an_error() -> None:
    who, plant = controller("browser-rider")
    given = sensing.Conditions(sensors=sensors.load("perfect"), duration=8.0)
    assert sensing.ride(who, plant, given, 50, seed=1).summary()["roll_error_rms_deg"] < 0.03


def test_steering_that_sticks_is_not_taken_for_one_that_turns() -> None:
    plant = registry.named("whipple", "browser-rider")
    given = sensing.Conditions(sensors=sensors.load("mpu6050"), friction=0.5)
    sticking = given.applied(plant)
    assert given.sensors is not None
    zero = np.zeros(1)
    state = sticking.initial(zero, zero, zero, np.array([4.0]))
    suite = SensorSuite(given.sensors, sticking, 1, 3)
    filters = [Filter(model, given.sensors) for model in (sticking, plant)]
    arrivals = Arrivals()
    arrivals.add(suite.rest(state))
    suite.begin(state)
    fastest = [0.0, 0.0]
    for step in range(40):
        torque = np.array([0.4 * math.sin(0.5 * step)])  # below the friction
        trace = sticking.trace(state, torque, zero, zero)
        arrivals.add(suite.advance(trace, PERIOD))
        state = trace[-1]
        due = arrivals.due(suite.time)
        for index, one in enumerate(filters):
            for reading, mask in due:
                one.take(reading, mask)
            rate = float(one.estimate(suite.time).steer_rate[0])
            fastest[index] = max(fastest[index], abs(rate))
    assert float(state.steer_angle[0]) == 0.0
    assert fastest[0] < 0.3 * fastest[1]
    assert fastest[1] > 0.02  # the model without friction believes that the torque turns it


def single_ride(
    steps: int = 240, bicycle: str = "browser-rider", preset: str = "mpu6050-rtk"
) -> tuple[list[list[tuple[Reading, np.ndarray]]], list[Any], Any, sensors.SensorSettings]:
    """Readings in the order of their arrival at each step's end, true states, the plant."""
    who, plant = controller(bicycle)
    given = sensors.load(preset)
    zero = np.zeros(1)
    state = plant.initial(zero, zero, zero, np.array([4.0]))
    suite, arrivals = SensorSuite(given, plant, 1, 3), Arrivals()
    arrivals.add(suite.rest(state))
    batches = [arrivals.due(suite.time)]
    states = []
    suite.begin(state)
    for index in range(steps):
        wanted = 0.3 * math.sin(0.5 * index * PERIOD)
        o = [state.steer_angle, state.steer_rate, state.lean_angle, state.lean_rate]
        seen = np.array([*o, state.lean_acceleration, state.heading - wanted]).T
        trace = plant.trace(state, who.act(seen, state.speed)[:, 0], zero, zero)
        arrivals.add(suite.advance(trace, PERIOD))
        batches.append(arrivals.due(suite.time))
        state = trace[-1]
        states.append(state)
    return batches, states, plant, given


def test_place_and_heading_follow_the_satellites_and_covariance_tells_the_error() -> None:
    batches, states, plant, given = single_ride()
    found = Filter(plant, given)
    for batch in batches:
        for reading, mask in batch:
            found.take(reading, mask)
    last = found.estimate(given.rest + len(states) * PERIOD)
    true = states[-1]
    assert np.hypot(last.x - true.rear_x, last.y - true.rear_y)[0] < 0.15
    assert abs(last.heading - true.heading)[0] < math.radians(3.0)
    spread = math.sqrt(last.covariance[0, LEAN, LEAN])
    assert abs(last.lean_angle - true.lean_angle)[0] < 4.0 * spread
    assert spread < math.radians(1.0)
    assert np.all(np.linalg.eigvalsh(last.covariance[0]) > 0.0)
    assert np.all(np.linalg.eigvalsh(last.course_covariance[0]) > 0.0)
    assert last.calibrated[0]
    body: Any = as_body(plant, last)
    assert body.front_x[0] == pytest.approx(true.front_x[0], abs=0.2)
    assert body.yaw_rate[0] == pytest.approx(true.yaw_rate[0], abs=0.05)


def test_same_readings_give_the_same_bits() -> None:
    batches, _, plant, given = single_ride(80)
    found = []
    for _ in range(2):
        result = Filter(plant, given)
        for batch in batches:
            for reading, mask in batch:
                result.take(reading, mask)
        found.append(result.estimate())
    for name, value in vars(found[0]).items():
        assert np.array_equal(value, getattr(found[1], name)), name


def test_rest_calibrates_biases() -> None:
    batches, _, plant, given = single_ride(1)
    suite = SensorSuite(given, plant, 1, 3)
    true = suite._sensors["imu"].gyro_bias[0]  # type: ignore[attr-defined]
    result = Filter(plant, given)
    assert not result.estimate().calibrated[0]
    for reading, mask in batches[0]:
        result.take(reading, mask)
    assert result.resting[0]
    last = result.estimate()
    assert last.calibrated[0]
    assert last.biases[0, 0] == pytest.approx(true[0], abs=5e-4)
    assert last.biases[0, 1] == pytest.approx(true[2], abs=5e-4)


def imu(stamp: float, gyro: tuple[float, ...], force: tuple[float, ...]) -> Reading:
    values = np.array([[*gyro, *force]])
    return Reading("imu", stamp, np.array([stamp]), np.array([False]), values)


def test_accelerometer_alone_is_not_lean() -> None:
    """A steady turn feels level; a filter that took the force for lean would say upright."""
    plant = registry.named("whipple", "browser-rider")
    given = replace(sensors.load("perfect"), rest=0.0)
    result = Filter(plant, given)
    speed, steer = 5.0, math.radians(6.0)
    lean = float(plant.steady_lean(np.array([steer]), np.array([speed]))[0])
    zero = np.zeros(1)
    state = plant.initial(zero, zero, zero, np.array([speed]))
    state = plant.settled(
        replace(state, steer_angle=np.array([steer]), lean_angle=np.array([lean]))
    )
    yaw = float(state.yaw_rate[0])
    gyro = (0.0, -math.sin(lean) * yaw, math.cos(lean) * yaw)
    force = (0.0, speed * yaw * math.cos(lean) - GRAVITY * math.sin(lean), GRAVITY / 1.0)
    assert abs(force[1]) < 0.2
    for index in range(1, 600):
        stamp = index * 0.01
        result.take(imu(stamp, gyro, force))
        for sensor, values in (("steer", [steer, 0.0]), ("wheel", [speed])):
            result.take(
                Reading(sensor, stamp, np.array([stamp]), np.array([False]), np.array([values]))
            )
    assert result.estimate().lean_angle[0] == pytest.approx(lean, abs=math.radians(1.0))
    assert lean > math.radians(10.0)


def test_late_reading_corrects_its_own_time() -> None:
    """The same readings, the steer encoder's 30 ms late: hardly another estimate."""
    batches, states, plant, given = single_ride(160)
    readings = [one for batch in batches for one in batch]
    truth = states[-1].lean_angle[0]
    errors = []
    for lateness in (0.0, 0.03):
        order = sorted(
            readings,
            key=lambda one: one[0].stamp + (lateness if one[0].sensor == "steer" else 0.0),
        )
        result = Filter(plant, given)
        for reading, mask in order:
            result.take(reading, mask)
        errors.append(result.estimate(given.rest + len(states) * PERIOD).lean_angle[0] - truth)
    assert abs(errors[1]) < math.radians(0.5)
    assert abs(errors[1] - errors[0]) < math.radians(0.2)


def test_a_roll_gyro_alone_is_enough_of_an_imu() -> None:
    batches, states, plant, given = single_ride(preset="mpu6050")
    found = Filter(plant, given)
    for batch in batches:
        for reading, mask in batch:
            one = reading
            if reading.sensor == "imu":
                values = reading.values.copy()
                values[:, 1:] = np.nan
                one = replace(reading, values=values)
            found.take(one, mask)
    last = found.estimate(given.rest + len(states) * PERIOD)
    assert abs(last.lean_angle - states[-1].lean_angle)[0] < math.radians(1.0)
    assert abs(last.lean_rate - states[-1].lean_rate)[0] < 0.1


def test_not_a_number_is_not_taken() -> None:
    batches, _, plant, given = single_ride(40)
    result = Filter(plant, given)
    for batch in batches:
        for reading, mask in batch:
            result.take(reading, mask)
    bad = imu(result.time, (math.nan, 0.0, 0.0), (0.0, 0.0, math.inf))
    result.take(bad)
    last = result.estimate()
    assert np.isfinite(last.lean_angle).all()
    assert np.isfinite(last.covariance).all()
