"""A ride from sensors only: recorded, near the truth, and made again to the bit from the bag."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from domains import claimed_domain
from node_process import NodeProcess
from rclpy.duration import Duration
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import TimeReference

from bicycle_bag.reader import BagReader
from bicycle_common.geometry import yaw_to_heading
from bicycle_common.nodes import convert, topics
from bicycle_common.nodes.runner import LOOP_EXECUTOR
from bicycle_common.nodes.topics import Topic, advertise
from bicycle_controller.estimation.steps import StepEstimator, Used, replayed
from bicycle_controller.nodes.estimator import Estimator, as_state
from bicycle_sim.nodes import sensor_messages
from bicycle_sim.nodes.episode_setting import to_setting
from bicycle_sim.plants import registry
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.sensors import settings as sensors
from bicycle_sim.sensors.reading import ORDER, Reading
from bicycle_sim.task.scenario import named

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
        time, *numbers = message.plant_state
        used = Used.of(numbers)
        if not begun:
            again.begin(time, 0.0, 0.0, float(yaw_to_heading(0.0)))
            begun = True
        found = replayed(again, readings, used, time)
        state = as_state(plant, found, message.episode, message.step, [time, *used.numbers])
        assert state.lean_angle == -message.lean_angle
        assert state.steer_rate == message.steer_rate
        assert state.rear_x == message.rear_contact.x
        number += 1
    assert number > 100
    assert abs(messages(folder, "/odom_estimated")[-1].pose.covariance[0]) > 0.0


class Late:
    """An estimator that hears the readings of a rest topic by topic, as who comes late does."""

    def __init__(self) -> None:
        """Begin with nothing published."""
        self.given = sensors.load(SENSORS)
        self.plant = registry.named("whipple", "browser-rider")
        self.node, self._sender = Node("late"), Node("sender")
        self.found: list[Any] = []
        self.estimator = Estimator(self.node, self.given, (0.0, 0.0, 0.0), self.found.append)
        names = (topics.IMU, topics.ENCODERS, topics.GNSS_FIX, topics.GNSS_VELOCITY)
        self._publishers = advertise(self._sender, *names, topics.SENSOR_TIME)
        self._executor: Executor = LOOP_EXECUTOR()
        self._executor.add_node(self.node)
        simulator = Simulator(named("random-start-random-goal"), self.plant, 1, self.given)
        simulator.reset()
        self.readings, self.time = simulator.readings, simulator.sensor_time
        self.topics: dict[str, list[Any]] = {topic.name: [] for topic in names}
        for reading in self.readings:
            for topic, message in sensor_messages.messages(reading, 0, self.given):
                self.topics[topic.name].append(message)

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        self._sender.destroy_node()

    def hear(self, topic: Topic, messages: list[Any]) -> None:
        """Publish on one topic, and let the estimator hear all of it."""
        publisher = self._publishers[topic.name]
        while publisher.get_subscription_count() == 0:
            self._executor.spin_once(timeout_sec=0.01)
        for message in messages:
            publisher.publish(message)
        publisher.wait_for_all_acked(Duration(seconds=5.0))
        for _ in range(5 * len(messages) + 50):
            self._executor.spin_once(timeout_sec=0.002)

    def ask(self, *steps: int) -> None:
        """Let it estimate steps, which come at once."""
        stamps = [self.time + step * self.plant.time_step for step in steps]
        messages = [
            TimeReference(
                header=convert.to_header(0),
                time_ref=convert.to_stamp(round(stamp * 1e9)),
                source=f"1 {step}",
            )
            for step, stamp in zip(steps, stamps, strict=True)
        ]
        self.hear(topics.SENSOR_TIME, messages)


@pytest.fixture
def late(ros_domain: int) -> Iterator[Late]:
    """Yield an estimator that has heard nothing."""
    rclpy.init(domain_id=ros_domain)
    result = Late()
    yield result
    result.close()
    rclpy.try_shutdown()


def test_it_uses_every_reading_though_the_topics_come_one_after_another(late: Late) -> None:
    """All fixes before all velocities once lost all but the last."""
    late.estimator.ride(late.plant)
    for topic in (topics.GNSS_FIX, topics.IMU, topics.GNSS_VELOCITY, topics.ENCODERS):
        late.hear(topic, late.topics[topic.name])
    late.ask(0)
    used = Used.of(late.found[-1].plant_state[1:])
    counts = [sum(one.sensor == sensor for one in late.readings) for sensor in ORDER]
    assert list(used.counts) == counts
    assert counts[ORDER.index("gnss")] > 30
    assert used.number == len(late.found)


def test_a_rest_that_came_before_the_word_of_another_bicycle_is_used(late: Late) -> None:
    late.estimator.ride(registry.default())
    for topic in (topics.IMU, topics.GNSS_VELOCITY, topics.GNSS_FIX, topics.ENCODERS):
        late.hear(topic, late.topics[topic.name])
    late.estimator.ride(late.plant)
    late.ask(0)
    assert sum(Used.of(late.found[-1].plant_state[1:]).counts) == len(late.readings)


def test_without_the_readings_of_a_sensor_it_waits(late: Late) -> None:
    late.estimator.ride(late.plant)
    late.hear(topics.IMU, late.topics[topics.IMU.name])
    late.hear(topics.GNSS_FIX, late.topics[topics.GNSS_FIX.name])
    late.hear(topics.GNSS_VELOCITY, late.topics[topics.GNSS_VELOCITY.name])
    late.ask(0)
    assert late.found == []
    late.hear(topics.ENCODERS, late.topics[topics.ENCODERS.name])
    late.ask(0)
    assert sum(Used.of(late.found[-1].plant_state[1:]).counts) == len(late.readings)


def test_who_is_late_estimates_the_newest_step_alone(late: Late) -> None:
    """It would never catch up with the bicycle if it answered every step of the past."""
    late.estimator.ride(late.plant)
    for topic in (topics.IMU, topics.ENCODERS, topics.GNSS_FIX, topics.GNSS_VELOCITY):
        late.hear(topic, late.topics[topic.name])
    late.ask(0)
    begun = len(late.found)
    late.ask(*range(1, 101))
    assert late.found[-1].step == 100
    assert len(late.found) < begun + 10
