"""A ride from sensors only: recorded, near the truth, and made again to the bit from the bag."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from domains import claimed_domain
from node_process import NodeProcess
from rclpy.serialization import deserialize_message

from bicycle_bag.reader import BagReader
from bicycle_common.geometry import yaw_to_heading
from bicycle_common.nodes import topics
from bicycle_controller.estimation.steps import StepEstimator, replayed
from bicycle_controller.nodes.estimator import as_state
from bicycle_sim.nodes import sensor_messages
from bicycle_sim.nodes.episode_setting import to_setting
from bicycle_sim.sensors import settings as sensors
from bicycle_sim.sensors.reading import Reading

pytestmark = [pytest.mark.ros, pytest.mark.slow]

RIDE = Path(__file__).resolve().parents[2] / "ros2_ws" / "ride.sh"
SENSORS = "mpu6050-rtk"
WORDS = (
    *("--goals", "2", "--field", "40", "--seed", "1", "simulator.pace:=lockstep"),
    *("simulator.plant:=whipple", "simulator.bicycle:=browser-rider"),
    *(f"simulator.sensors:={SENSORS}", "controller.state:=estimated"),
    *(f"controller.sensors:={SENSORS}", "controller.policy:=lqr"),
)


@pytest.fixture(scope="module")
def ridden(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[NodeProcess, Path]]:
    """Yield one ride to its end, and its folder."""
    folder = tmp_path_factory.mktemp("ride") / "run"
    words = [str(RIDE), *WORDS, "--output", str(folder)]
    with claimed_domain() as domain, NodeProcess(words, {"ROS_DOMAIN_ID": str(domain)}) as ride:
        ride.wait()
        yield ride, folder


def messages(folder: Path, topic: str) -> list[Any]:
    """Messages of a topic of the ride's bag."""
    kind = next(one.type for one in topics.TOPICS if topic == f"/{one.name}")
    found = BagReader(folder / "bag").messages([topic])
    return [deserialize_message(one.data, kind) for one in found]


def test_it_reaches_its_goals_from_estimates(ridden: tuple[NodeProcess, Path]) -> None:
    ride, folder = ridden
    assert ride.wait() == 0, ride.output
    true = {(m.episode, m.step): m for m in messages(folder, "/bicycle/state")}
    estimates = messages(folder, "/bicycle/estimate")
    assert len({m.step for m in estimates}) >= len({key[1] for key in true}) - 2
    assert all(m.estimated for m in estimates)
    errors = [
        m.lean_angle - true[m.episode, m.step].lean_angle
        for m in estimates
        if m.step > 40 and (m.episode, m.step) in true
    ]
    assert math.degrees(float(np.sqrt(np.mean(np.square(errors))))) < 0.5


def test_sensors_are_in_the_bag_and_make_the_same_estimates(
    ridden: tuple[NodeProcess, Path],
) -> None:
    _, folder = ridden
    given = sensors.load(SENSORS)
    readings: list[Reading] = [
        sensor_messages.from_imu(m) for m in messages(folder, "/imu/data_raw")
    ]
    for message in messages(folder, "/encoders"):
        readings += sensor_messages.from_encoders(message)
    speeds = {sensor_messages.seconds(m.header.stamp): m for m in messages(folder, "/gnss/vel")}
    readings += [
        sensor_messages.from_gnss(m, speeds[sensor_messages.seconds(m.header.stamp)], given)
        for m in messages(folder, "/gnss/fix")
    ]
    _, plant = to_setting(messages(folder, "/bicycle/episode")[-1])
    again = StepEstimator(plant, given)
    estimates = messages(folder, "/bicycle/estimate")
    times = {sensor_messages.seconds(m.time_ref): m for m in messages(folder, "/sensors/time")}
    assert set(times) >= {m.plant_state[0] for m in estimates}
    begun = False
    number = 0
    for message in estimates:
        time, *used = message.plant_state
        if not begun:
            again.begin(time, 0.0, 0.0, float(yaw_to_heading(0.0)))
            begun = True
        found = replayed(again, readings, used, time)
        state = as_state(plant, found, message.episode, message.step, [time, *used])
        assert state.lean_angle == -message.lean_angle
        assert state.steer_rate == message.steer_rate
        assert state.rear_x == message.rear_contact.x
        number += 1
    assert number > 100
    assert abs(messages(folder, "/odom_estimated")[-1].pose.covariance[0]) > 0.0
