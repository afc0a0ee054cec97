"""Goals become orders, and a goal's message tells what is not as it was asked."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator

import numpy as np
import pytest
from probe import Probe, goal

from bicycle_common.nodes import convert
from bicycle_common.types import InitialPose
from bicycle_controller.control.control_loop import ControlLoop
from bicycle_controller.control.goals import Event, Goal, GoalTracker, Status
from bicycle_controller.control.guidance import Guidance, GuidanceConfig
from bicycle_controller.control.lqr import LqrController
from bicycle_controller.nodes.controller_settings import ControllerSettings
from bicycle_controller.nodes.goal_desk import GoalDesk
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("no_new_shared_memory")]

YAW = 0.5
"""rad, direction in which the bicycle rides."""


@pytest.fixture
def desk(ros_domain: int) -> Iterator[GoalDesk]:
    """The desk of a bicycle that rides in the direction YAW."""
    probe, tracker = Probe(ros_domain), GoalTracker()
    loop = ControlLoop("test", LqrController(), tracker, np.array([2.0, 0.0, 100.0]))
    guidance = Guidance(loop, GuidanceConfig())
    simulator = Simulator(named("learned-speed"))
    simulator.reset(InitialPose(0.0, 0.0, YAW - math.pi / 2, 3.0))
    guidance.poll(simulator.snapshot)
    yield GoalDesk(
        probe.node,
        guidance,
        tracker,
        threading.Lock(),
        lambda topic, message: None,
        ControllerSettings,
        lambda: True,
    )
    probe.close()


def reached(goal_id: int, status: Status = Status.REACHED) -> Event:
    return Event(status, Goal(goal_id, (9.0, 0.0)), 0.9, 1.0, 3.0, 0, "reached after 1.0 s")


@pytest.mark.parametrize("degrees", [0.0, -9.0, 12.0, -143.0])
def test_an_arrival_in_a_wrong_direction_says_so(desk: GoalDesk, degrees: float) -> None:
    pose = goal(9.0, 0.0)
    pose.pose.orientation = convert.to_quaternion(YAW + math.radians(degrees))
    (first, last), _ = desk.ride([goal(5.0, 0.0), pose], True)
    assert desk.judge(reached(first)) == reached(first)
    assert desk.judge(reached(last, Status.MISSED)) == reached(last, Status.MISSED)
    message = desk.judge(reached(last)).message
    off = f"; arrived {abs(degrees):.0f} degrees off the asked heading"
    assert message == "reached after 1.0 s" + (off if abs(degrees) > 10.0 else "")


def test_a_goal_that_asks_for_no_direction_is_reached_in_any(desk: GoalDesk) -> None:
    (first,), _ = desk.ride([goal(9.0, 0.0)], False)
    assert desk.judge(reached(first)) == reached(first)
