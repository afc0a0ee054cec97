"""Whatever comes in any field of any message or request, a node answers the next sound one.

The nodes are the real ones, made in this process; their subscriptions and services are found by
asking them, and the fields by asking the messages, so a new one is covered when it is there.
"""

from __future__ import annotations

import inspect
import itertools
import json
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import rclpy
from bicycle_msgs.msg import BicycleCommand, BicycleState, EpisodeInfo
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from message_fuzz import each_field, several_fields
from nav_msgs.msg import Path as PathMessage
from rclpy.node import Node

from bicycle_common.nodes import convert, topics
from bicycle_common.types import Command, InitialPose
from bicycle_controller.nodes.controller_node import ControllerNode
from bicycle_controller.nodes.trainer_node import TrainerNode
from bicycle_sim.nodes.sim_node import SimNode
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named

pytestmark = pytest.mark.ros

SCENARIO = named("random-start-random-goal")
LIMITS = SCENARIO.action_limits
SEVERAL = settings(
    max_examples=40,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
AWAITS = ("load_policy",)
"""Services that answer later; what they are given is a policy's name: test_policy_file.py."""

SENT = itertools.count(1)
"""Times of sending, ns, each another."""


@pytest.fixture
def ros(ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("ROS_PYTHON_CHECK_FIELDS", "1")
    rclpy.init(args=["test", "--ros-args", "--log-level", "FATAL"], domain_id=ros_domain)
    yield
    rclpy.try_shutdown()


@pytest.fixture
def simulator(ros: None) -> Iterator[SimNode]:
    node = SimNode()
    yield node
    node.destroy_node()


@pytest.fixture
def controller(ros: None) -> Iterator[ControllerNode]:
    node = ControllerNode()
    yield node
    node.destroy_node()


def state(step: int = 0, episode: int = 1) -> BicycleState:
    """Return a sound one."""
    simulator = Simulator(SCENARIO)
    simulator.reset(InitialPose(0.0, 0.0, 0.0, SCENARIO.start_speed))
    for _ in range(3):
        simulator.step(None)
    message = convert.from_snapshot(simulator.snapshot, 25_000_000 * (step + 1))
    message.episode, message.step = episode, step
    return message


def episode() -> EpisodeInfo:
    return EpisodeInfo(
        episode=1,
        pace="realtime",
        scenario=SCENARIO.to_json(),
        physics=ChoiPlant().to_json(),
        version="test",
    )


def goal() -> PoseStamped:
    pose = PoseStamped()
    pose.header.frame_id = "odom"
    pose.pose.position.x, pose.pose.position.y = 20.0, 10.0
    return pose


def path() -> PathMessage:
    path = PathMessage(poses=[goal(), goal()])
    path.header.frame_id = "odom"
    return path


def start_pose() -> PoseWithCovarianceStamped:
    pose = PoseWithCovarianceStamped()
    pose.header.frame_id = "odom"
    pose.pose.pose.orientation.w = 1.0
    return pose


SOUND: dict[Any, Callable[[], Any]] = {
    BicycleState: state,
    EpisodeInfo: episode,
    PoseStamped: goal,
    PathMessage: path,
    PoseWithCovarianceStamped: start_pose,
}
"""Messages to vary whose zeros would be rejected at once."""


def sound(kind: Any) -> Any:
    return SOUND.get(kind, kind)()


def strange_json(text: str) -> Iterator[str]:
    """Yield a JSON mapping with each of its values, however deep, replaced by strange ones."""

    def walk(value: Any, put: Callable[[Any], Any]) -> Iterator[Any]:
        for other in (None, "text", -1, 1e308, math.nan, [1, 2, 3]):
            yield put(other)
        if isinstance(value, dict):
            for key in value:
                rest = {k: v for k, v in value.items() if k != key}
                yield put(rest)
                yield from walk(
                    value[key],
                    lambda new, key=key: put({**value, key: new}),  # type: ignore[misc]
                )

    for found in walk(json.loads(text), lambda new: new):
        yield json.dumps(found)


def hear(subscription: Any, message: Any) -> None:
    """Call a subscription's callback as rclpy does: with the message's facts if it takes them."""
    facts = {"source_timestamp": next(SENT), "received_timestamp": 0}
    takes = len(inspect.signature(subscription.callback).parameters)
    subscription.callback(*(message, facts)[:takes])


def heard_by(node: Node) -> list[Any]:
    return [found for found in node.subscriptions if found.msg_type.__module__ != "rcl_interfaces"]


# The controller.


def drives(node: ControllerNode, count: int) -> bool:
    """Return True if a sound goal and a sound state are answered by a sound command."""
    node._on_episode(episode())
    node._goals._on_goal_pose(goal())
    node._on_state(state(step=count, episode=7))
    command = node._loop._command
    assert command is not None
    return bool((np.abs(command.action) <= LIMITS).all())


def commands_of(node: ControllerNode, monkeypatch: pytest.MonkeyPatch) -> list[BicycleCommand]:
    sent: list[BicycleCommand] = []
    publisher = node._publishers_by_name[topics.COMMAND.name]
    real = publisher.publish

    def publish(command: BicycleCommand) -> None:
        sent.append(command)
        real(command)

    monkeypatch.setattr(publisher, "publish", publish)
    return sent


def test_no_field_of_what_the_controller_hears_breaks_it(
    controller: ControllerNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent = commands_of(controller, monkeypatch)
    assert {found.msg_type for found in heard_by(controller)} >= {BicycleState, EpisodeInfo}
    count = 0
    for subscription in heard_by(controller):
        for message in each_field(sound(subscription.msg_type)):
            hear(subscription, message)
            count += 1
        assert drives(controller, count)
    for message in sent:
        assert all(map(math.isfinite, convert.to_command(message).action))
    assert count > 300


def test_no_episode_info_breaks_the_controller(controller: ControllerNode) -> None:
    for name in ("scenario", "physics"):
        for text in strange_json(getattr(episode(), name)):
            message = episode()
            setattr(message, name, text)
            controller._on_episode(message)
            controller._on_state(state())
    assert drives(controller, 50)


@SEVERAL
@given(data=st.data())
def test_no_mixture_breaks_the_controller(controller: ControllerNode, data: st.DataObject) -> None:
    subscription = data.draw(st.sampled_from(heard_by(controller)))
    hear(subscription, data.draw(several_fields(sound(subscription.msg_type))))
    assert drives(controller, data.draw(st.integers(0, 2**36)))


# The simulator.


def rides(node: SimNode) -> bool:
    """Return True if a sound command still makes a step to a finite state, after a reset."""
    node._begin(InitialPose(0.0, 0.0, 0.0, 2.5), 1)
    now = node._loop.snapshot
    node._loop.validator.release = -1.0  # whoever was in charge is not any more
    node._on_command(
        convert.from_command(Command(now.episode, now.step, 0.1, 0.0, 0.0), to_stamp())
    )
    node._loop.tick()
    return node._loop.snapshot.step == 1 and node._loop.snapshot.is_finite


def to_stamp() -> Any:
    return convert.to_stamp(0)


def test_no_field_of_what_the_simulator_hears_breaks_it(simulator: SimNode) -> None:
    for subscription in heard_by(simulator):
        for message in each_field(sound(subscription.msg_type)):
            hear(subscription, message)
            simulator._on_due()
            assert simulator._loop.snapshot.is_finite
        assert rides(simulator)


def test_no_request_breaks_the_simulator(simulator: SimNode) -> None:
    own = [one for one in simulator.services if "bicycle/" in one.srv_name]
    assert len(own) == 4
    for service in own:
        for request in each_field(service.srv_type.Request()):
            response = service.callback(request, service.srv_type.Response())
            assert "\n" not in response.message
            assert simulator._loop.snapshot.is_finite
        simulator._loop.pause(False)
        assert rides(simulator)


@SEVERAL
@given(data=st.data())
def test_no_mixture_breaks_the_simulator(simulator: SimNode, data: st.DataObject) -> None:
    subscription = data.draw(st.sampled_from(heard_by(simulator)))
    hear(subscription, data.draw(several_fields(sound(subscription.msg_type))))
    simulator._on_due()
    assert rides(simulator)


# The trainer.


def test_no_field_of_what_the_trainer_hears_breaks_it(
    ros: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch")
    node = TrainerNode()
    orders: list[Any] = []
    monkeypatch.setattr(node, "_start", lambda link, text: orders.append(link))
    monkeypatch.setattr("bicycle_controller.nodes.trainer_node.TrainerClient", lambda order: order)
    for subscription in heard_by(node):
        for message in each_field(sound(subscription.msg_type)):
            hear(subscription, message)
    node._status()
    assert orders, "a sound episode among them begins the learning"
    node.destroy_node()
