"""Sensors that are gone, late or stuck are told, and healthy ones are not."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from bicycle_controller.control.lqr import LqrConfig, LqrController
from bicycle_controller.estimation.queue import Arrivals
from bicycle_controller.estimation.watch import SensorWatch
from bicycle_sim.plants import registry
from bicycle_sim.sensors import settings as sensors
from bicycle_sim.sensors.reading import Reading
from bicycle_sim.sensors.suite import SensorSuite

PERIOD = 0.025


def problems(
    speed_up: float = 0.0,
    /,
    preset: str = "mpu6050-rtk",
    rest: float = 1.0,
    turn: float = 0.5,
    usual: Mapping[str, Mapping[str, object]] | None = None,
    **changed: Any,
) -> tuple[str, ...]:
    """Return all problems reported during a rest and a ride of 8 s with turns, by sensor.

    Args:
        speed_up: N of drive.
        preset: of the sensors.
        rest: s.
        turn: rad, of the heading, to and fro.
        usual: settings beside the preset's, which the watch knows.
        changed: others, which it does not know.
    """
    plant = registry.named("whipple", "browser-rider")
    who = LqrController(LqrConfig(torque_limit=7.0), plant)
    data = sensors.load(preset).to_dict() | {"rest": rest}
    for name, values in (usual or {}).items():
        data[name] = {**data[name], **values}
    known = sensors.from_dict(data)
    for name, values in changed.items():
        data[name] = {**data[name], **values}
    given = sensors.from_dict(data)
    suite, arrivals = SensorSuite(given, plant, 1, 3), Arrivals()
    watch = SensorWatch(known, plant.geometry.wheelbase)
    zero = np.zeros(1)
    found: list[str] = []
    bias = float(suite._sensors["imu"].gyro_bias[0, 2])  # type: ignore[attr-defined]

    def look(bias: float) -> None:
        due = arrivals.due(suite.time)
        for index, (reading, _) in enumerate(due):
            watch.take(reading, float(reading.arrival[0]), bias)
            if index % 50 == 0 or index == len(due) - 1:
                found.extend(one.partition(" since")[0] for one in watch.problems(reading.stamp))

    state = plant.initial(zero, zero, zero, np.array([4.0]))
    if rest > 0.0:
        arrivals.add(suite.rest(state))
    look(0.0)  # the rest is yet to tell it
    suite.begin(state)
    for index in range(320):
        wanted = turn * (1.0 if (index // 60) % 2 else -1.0)
        o = [state.steer_angle, state.steer_rate, state.lean_angle, state.lean_rate]
        seen = np.array([*o, state.lean_acceleration, state.heading - wanted]).T
        pedal = np.full(1, speed_up)
        trace = plant.trace(state, who.act(seen, state.speed)[:, 0], zero, pedal)
        arrivals.add(suite.advance(trace, PERIOD))
        state = trace[-1]
        look(bias)
        if index % 2:
            found += [text.partition(" since")[0] for text in watch.problems(suite.time)]
    return tuple(dict.fromkeys(found))


def test_healthy_sensors_are_not_complained_of() -> None:
    assert problems() == ()
    assert problems(400.0) == ()


@pytest.mark.parametrize("preset", sensors.names())
@pytest.mark.parametrize("turn", [0.0, 0.5])
def test_no_preset_is_complained_of(preset: str, turn: float) -> None:
    assert problems(preset=preset, turn=turn, rest=sensors.load(preset).rest) == ()


def test_a_long_rest_with_large_biases_is_not_complained_of() -> None:
    biases = {"gyro_bias": 0.12, "accelerometer_bias": 0.5, "misalignment": 2.0}
    assert problems(rest=20.0, usual={"imu": biases}) == ()


@pytest.mark.parametrize("mounting", [(12.0, -20.0, 90.0), (180.0, 0.0, 0.0), (0.0, 90.0, 0.0)])
def test_an_imu_that_is_mounted_otherwise_judges_as_well(mounting: tuple[float, ...]) -> None:
    mounted: dict[str, Any] = {"imu": {"mounting": mounting}}
    assert problems(usual=mounted, rest=5.0) == ()
    assert problems(usual=mounted, steer={"stuck_from": 4.0}) == ("steer stuck",)
    assert problems(400.0, usual=mounted, wheel={"stuck_from": 3.0}) == ("wheel stuck",)


@pytest.mark.parametrize("sensor", ["imu", "steer", "wheel", "gnss"])
def test_gone(sensor: str) -> None:
    fault: dict[str, Any] = {sensor: {"gone_from": 4.0}}
    assert problems(**fault) == (f"{sensor} gone",)


@pytest.mark.parametrize("sensor", ["imu", "steer", "wheel"])
def test_late(sensor: str) -> None:
    fault: dict[str, Any] = {sensor: {"latency": 0.1}}
    assert problems(**fault) == (f"{sensor} late",)


def test_stuck() -> None:
    assert problems(imu={"stuck_from": 4.0}) == ("imu stuck",)
    assert problems(steer={"stuck_from": 4.0}) == ("steer stuck",)
    assert problems(400.0, wheel={"stuck_from": 3.0}) == ("wheel stuck",)


def test_a_receiver_that_repeats_its_last_fix_is_stuck() -> None:
    assert problems(gnss={"stuck_from": 4.0}) == ("gnss stuck",)
    assert problems(preset="perfect", rest=0.0, gnss={"stuck_from": 4.0}) == ("gnss stuck",)


def test_an_imu_without_noise_or_with_a_roll_gyro_alone_is_told_to_be_stuck() -> None:
    assert problems(preset="perfect", rest=0.0, imu={"stuck_from": 4.0}) == ("imu stuck",)
    watch, zero = SensorWatch(sensors.load("mpu6050"), 1.1), np.zeros(1)
    for index in range(12):
        values = np.array([[0.01 * min(index, 4), *[math.nan] * 5]])
        stamp = 0.01 * (index + 1)
        watch.take(Reading("imu", stamp, zero + stamp, zero > 1.0, values), stamp)
    assert next(one.partition(" since")[0] for one in watch.problems(0.12)) == "imu stuck"


def test_time_since_when_is_told() -> None:
    watch = SensorWatch(sensors.load("mpu6050"), 1.1)
    assert watch.problems(0.05) == ()
    assert [text.split(" since")[0] for text in watch.problems(1.0)] == [
        "imu gone",
        "steer gone",
        "wheel gone",
    ]
    assert "since 0.00 s" in watch.problems(2.0)[0]
