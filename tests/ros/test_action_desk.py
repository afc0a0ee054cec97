"""Actions of the controller: goals, courses, feedback, results, cancel and preemption."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pytest
from bicycle_msgs.action import RideToPose
from node_process import NodeProcess
from probe import Probe
from rclpy.action import ActionClient
from waiting import PATIENCE, until

from bicycle_common.nodes import topics
from bicycle_common.nodes.goal_orders import to_order
from bicycle_common.nodes.topics import STATE
from bicycle_controller.control.goals import Status
from bicycle_controller.control.guide import PathEnd
from bicycle_tools.nodes import commander
from bicycle_tools.nodes.commander import BicycleCommander, CommanderError

pytestmark = [
    pytest.mark.ros,
    pytest.mark.slow,
    pytest.mark.usefixtures("no_new_shared_memory"),
]

StartNode = Callable[..., NodeProcess]


def words(**values: object) -> list[str]:
    return ["--ros-args", *(w for n, v in values.items() for w in ("-p", f"{n}:={v}"))]


@pytest.fixture
def bicycle(
    start_node: StartNode, ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> Iterator[BicycleCommander]:
    """A Whipple bicycle with rider, ridden in lock-step."""
    sim = words(
        pace="lockstep", plant="whipple", bicycle="browser-rider", scenario="learned-speed"
    )
    start_node("bicycle_sim.nodes.sim_node", sim).wait_for_line("episode 1 waits")
    start_node(
        "bicycle_controller.nodes.controller_node", words(policy="lqr-pedal")
    ).wait_for_line("waits for a goal")
    monkeypatch.setattr(commander, "READY", PATIENCE)
    with BicycleCommander() as client:
        yield client


@pytest.fixture
def probe(ros_domain: int) -> Iterator[Probe]:
    probe = Probe(ros_domain, STATE, topics.PATH_STATUS, topics.FOLLOWED_PATH, topics.COMMAND)
    yield probe
    probe.close()


def test_goals_courses_and_paths_by_action(bicycle: BicycleCommander, probe: Probe) -> None:
    feedback: list[Any] = []
    bicycle.ride_to(30.0, 5.0)
    ridden = bicycle.wait(feedback.append, PATIENCE)
    assert ridden.reached, ridden.message
    assert ridden.result.status == Status.REACHED
    assert ridden.result.distance <= 1.0
    assert len(feedback) > 1
    assert feedback[0].distance > feedback[-1].distance

    # The direction of arrival is kept, also where it is straight back.
    bicycle.ride_to(30.0, 5.0, yaw=math.pi / 2)
    arrived = bicycle.wait(timeout=PATIENCE)
    assert arrived.reached, arrived.message
    assert abs(arrived.result.heading_error) < math.radians(10.0)

    # In lock-step it rides on until the order comes, by far on a busy machine: the first lap may
    # begin anywhere, and the last one ends on the path.
    on_path: list[Any] = []
    bicycle.follow_course("circle-20", laps=2, speed=3.0)
    path = bicycle.wait(on_path.append, PATIENCE)
    assert path.reached, path.message
    assert path.result.status == PathEnd.FINISHED
    assert abs(on_path[-1].cross_track) < 0.3
    probe.spin_until(
        lambda: any(
            (one.name, one.status) == ("circle-20", PathEnd.FINISHED)
            for one in probe[topics.PATH_STATUS]
        )
    )
    assert len(probe[topics.FOLLOWED_PATH]) >= 1
    policies = {one.policy.partition("-")[0] for one in probe[topics.COMMAND]}
    assert "follow" in policies

    bicycle.follow_path([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (2.0, 1.0)])
    refused = bicycle.wait(timeout=PATIENCE)
    assert not refused.reached
    assert "m at least" in refused.message
    assert refused.result.status == PathEnd.REJECTED

    bicycle.follow_course("slalon")
    assert "did you mean 'slalom'" in bicycle.wait(timeout=PATIENCE).message


def test_an_order_that_comes_as_soon_as_it_can_is_taken(
    start_node: StartNode, ros_domain: int
) -> None:
    start_node("bicycle_sim.nodes.sim_node", words(pace="lockstep")).wait_for_line("waits")
    for _ in range(5):  # the actions' thread may serve while the node is still being made
        probe = Probe(ros_domain, topics.GOAL_STATUS)
        client = ActionClient(probe.node, RideToPose, topics.RIDE_TO_POSE.name)
        controller = start_node("bicycle_controller.nodes.controller_node", words(policy="lqr"))
        until(client.server_is_ready)
        client.send_goal_async(to_order([(1e4, 0.0)]))
        heard = probe[topics.GOAL_STATUS]
        probe.spin_until(partial(len, heard))
        told = heard[0]
        assert told.status != Status.REJECTED, told.message
        client.destroy()
        probe.close()
        assert controller.stop() == 0


def test_goals_in_order_with_a_direction_at_the_last(
    bicycle: BicycleCommander, ros_domain: int
) -> None:
    ordered = Probe(ros_domain, topics.ORDERED_GOALS)
    ordered.meet(topics.ORDERED_GOALS)
    left: list[int] = []
    bicycle.ride_through([(20.0, 0.0), (45.0, 10.0)], yaw=math.pi / 2)
    outcome = bicycle.wait(lambda feedback: left.append(feedback.remaining), 120.0)
    assert outcome.reached, outcome.message
    assert abs(outcome.result.heading_error) < math.radians(10.0)
    assert sorted(set(left), reverse=True) == [2, 1]
    ordered.spin_until(lambda: bool(ordered[topics.ORDERED_GOALS]))
    sent = ordered[topics.ORDERED_GOALS][-1].poses
    assert [(one.pose.position.x, one.pose.position.y) for one in sent] == [(20, 0), (45, 10)]
    ordered.close()

    bicycle.ride_to(2000.0, 0.0, timeout=5.0)
    late = bicycle.wait(timeout=120.0)
    assert not late.reached
    assert (late.result.status, late.message) == (Status.GIVEN_UP, "not reached within 5 s")


def test_goal_sh_orders_by_action(
    bicycle: BicycleCommander, start_node: StartNode, ros_domain: int
) -> None:
    ordered = Probe(ros_domain, topics.ORDERED_GOALS, topics.GOAL_POSE, topics.GOAL_PATH)
    ordered.meet(topics.ORDERED_GOALS)
    bicycle.ride_to(2000.0, 0.0)
    sent = start_node("bicycle_tools.nodes.goal", ["12", "3", "--wait"])
    assert sent.wait(120.0) == 0
    assert not bicycle.wait(timeout=60.0).reached  # a newer order came
    ordered.spin_until(lambda: len(ordered[topics.ORDERED_GOALS]) >= 1)
    assert ordered[topics.GOAL_POSE] == ordered[topics.GOAL_PATH] == []
    ordered.close()


def test_an_order_can_be_cancelled_and_is_replaced_by_a_newer_one(
    bicycle: BicycleCommander, ros_domain: int
) -> None:
    bicycle.follow_course("circle-20", laps=5)
    seen: list[float] = []

    def ridden() -> bool:
        assert not bicycle.done  # which spins
        if bicycle.feedback is not None and bicycle.feedback.along not in seen:
            seen.append(bicycle.feedback.along)
        return len(seen) == 3

    until(ridden)
    bicycle.cancel()
    ended = bicycle.wait(timeout=PATIENCE)
    assert ended.cancelled
    assert ended.result.status == PathEnd.CANCELLED

    bicycle.ride_to(500.0, 0.0)
    with BicycleCommander() as other:
        other.ride_to(0.0, 40.0)
        first = bicycle.wait(timeout=PATIENCE)
        assert not first.reached
        assert first.result.status == Status.REPLACED
        assert other.wait(timeout=PATIENCE).reached


def test_an_order_goes_on_until_the_next_path_is_taken(bicycle: BicycleCommander) -> None:
    bicycle.ride_to(2000.0, 0.0)
    with BicycleCommander() as other:
        other.follow_path([(0.0, 0.0), (50.0, 0.0), (5.0, 0.0)])
        refused = other.wait(timeout=PATIENCE)
        assert (refused.reached, refused.result.status) == (False, PathEnd.REJECTED)
        assert "the corner of 180°" in refused.message
        assert not bicycle.done
        bicycle.cancel()
        ended = bicycle.wait(timeout=PATIENCE)
        assert (ended.cancelled, ended.result.status) == (True, Status.CANCELLED)
        bicycle.ride_to(2000.0, 0.0)
        other.follow_path([(0.0, 0.0), (4000.0, 0.0)])  # a busy machine may be far ahead by now
        first = bicycle.wait(timeout=PATIENCE)
        assert (first.cancelled, first.result.status) == (False, Status.REPLACED)
        assert first.message == "a newer order came"
        other.cancel()
        assert other.wait(timeout=PATIENCE).cancelled


def test_without_a_controller_the_remedy_is_told(
    ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(commander, "READY", 0.3)
    with BicycleCommander() as alone:
        with pytest.raises(CommanderError, match=r"controller\.sh"):
            alone.ride_to(1.0, 1.0)
        with pytest.raises(CommanderError, match="no order was given"):
            alone.wait()


def test_a_failed_order_does_not_stand_for_the_one_before(
    start_node: StartNode, ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    controller = start_node("bicycle_controller.nodes.controller_node", words(policy="lqr"))
    controller.wait_for_line("waits for a goal")
    with BicycleCommander() as bicycle:
        bicycle.ride_to(1.0, 1.0)
        controller.stop()
        monkeypatch.setattr(commander, "READY", 0.3)

        def refused() -> bool:  # the graph forgets the controller after a moment
            try:
                bicycle.ride_to(2.0, 2.0)
            except CommanderError:
                return True
            return False

        until(refused)
        with pytest.raises(CommanderError, match="no order was given"):
            bicycle.wait(timeout=1.0)


def test_path_sh_takes_a_namespace_as_every_script_does(
    start_node: StartNode, ros_domain: int
) -> None:
    for extra in (["__ns:=/b1"], ["--namespace", "/b1"]):
        done = start_node("bicycle_tools.nodes.path", ["slalom", *extra])
        assert done.wait(60.0) == 4
        assert "nobody serves /b1/bicycle/follow_path" in done.output
