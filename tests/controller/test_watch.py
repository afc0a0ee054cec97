"""Sensors that are gone, late or stuck are told, and healthy ones are not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bicycle_controller.control.lqr import LqrConfig, LqrController
from bicycle_controller.estimation.queue import Arrivals
from bicycle_controller.estimation.watch import SensorWatch
from bicycle_sim.plants import registry
from bicycle_sim.sensors import settings as sensors
from bicycle_sim.sensors.suite import SensorSuite

PERIOD = 0.025


def problems(speed_up: float = 0.0, /, **changed: Any) -> tuple[str, ...]:
    """Return all problems reported during a ride of 8 s with turns, by sensor."""
    plant = registry.named("whipple", "browser-rider")
    who = LqrController(LqrConfig(torque_limit=7.0), plant)
    data = sensors.load("mpu6050-rtk").to_dict() | {"rest": 1.0}
    for name, values in changed.items():
        data[name] = {**data[name], **values}
    given, usual = sensors.from_dict(data), sensors.load("mpu6050-rtk")
    suite, arrivals = SensorSuite(given, plant, 1, 3), Arrivals()
    watch = SensorWatch(usual, 1.1)
    zero = np.zeros(1)
    state = plant.initial(zero, zero, zero, np.array([4.0]))
    arrivals.add(suite.rest(state))
    suite.begin(state)
    found: list[str] = []
    bias = float(suite._sensors["imu"].gyro_bias[0, 2])  # type: ignore[attr-defined]
    for index in range(320):
        wanted = 0.5 * (1.0 if (index // 60) % 2 else -1.0)
        o = [state.steer_angle, state.steer_rate, state.lean_angle, state.lean_rate]
        seen = np.array([*o, state.lean_acceleration, state.heading - wanted]).T
        pedal = np.full(1, speed_up)
        trace = plant.trace(state, who.act(seen, state.speed)[:, 0], zero, pedal)
        arrivals.add(suite.advance(trace, PERIOD))
        state = trace[-1]
        for reading, _ in arrivals.due(suite.time):
            watch.take(reading, float(reading.arrival[0]), bias)
        found += [text.partition(" since")[0] for text in watch.problems(suite.time)]
    return tuple(dict.fromkeys(found))


def test_healthy_sensors_are_not_complained_of() -> None:
    assert problems() == ()
    assert problems(400.0) == ()


@pytest.mark.parametrize("sensor", ["imu", "steer", "wheel", "gnss"])
def test_gone(sensor: str) -> None:
    assert problems(0.0, **{sensor: {"gone_from": 4.0}}) == (f"{sensor} gone",)


@pytest.mark.parametrize("sensor", ["imu", "steer", "wheel"])
def test_late(sensor: str) -> None:
    assert problems(0.0, **{sensor: {"latency": 0.1}}) == (f"{sensor} late",)


def test_stuck() -> None:
    assert problems(imu={"stuck_from": 4.0}) == ("imu stuck",)
    assert problems(steer={"stuck_from": 4.0}) == ("steer stuck",)
    assert problems(400.0, wheel={"stuck_from": 3.0}) == ("wheel stuck",)


def test_time_since_when_is_told() -> None:
    watch = SensorWatch(sensors.load("mpu6050"), 1.1)
    assert watch.problems(0.05) == ()
    assert [text.split(" since")[0] for text in watch.problems(1.0)] == [
        "imu gone",
        "steer gone",
        "wheel gone",
    ]
    assert "since 0.00 s" in watch.problems(2.0)[0]
