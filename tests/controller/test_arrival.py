"""A goal with a heading: the points to ride by, and the direction in which real rides arrive."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bicycle_common.geometry import heading_to_yaw, wrap_angle, yaw_to_heading
from bicycle_common.types import InitialPose
from bicycle_controller.control.arrival import LEAD, RUN_UP, approach
from bicycle_controller.control.control_loop import ControlLoop
from bicycle_controller.control.goals import GoalTracker, Status
from bicycle_controller.policy.policy import load_controller
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named

SCENARIO = named("random-start-random-goal")


def test_a_goal_straight_on_needs_one_point_before_it() -> None:
    assert approach((40.0, 0.0), 0.0, (0.0, 0.0)) == [(40.0 - LEAD, 0.0), (40.0, 0.0)]


def test_a_bicycle_from_ahead_gets_room_to_turn() -> None:
    far, near, goal = approach((0.0, 0.0), math.pi / 2, (0.0, 50.0))
    assert far == pytest.approx((0.0, -RUN_UP))
    assert near == pytest.approx((0.0, -LEAD))
    assert goal == (0.0, 0.0)


def arrival(policy: str, rng: np.random.Generator) -> float:
    """rad between the wanted direction and the one in which a ride reaches its goal."""
    simulator = Simulator(SCENARIO)
    heading, yaw = (float(value) for value in rng.uniform(-math.pi, math.pi, 2))
    goal = float(rng.uniform(-40, 40)), float(rng.uniform(-40, 40))
    snapshot = simulator.reset(
        InitialPose(0.0, 0.0, float(yaw_to_heading(yaw)), SCENARIO.start_speed)
    )
    tracker = GoalTracker(SCENARIO.goal_radius)
    driver = ControlLoop("me", load_controller(policy), tracker, SCENARIO.action_limits)
    tracker.replace(approach(goal, heading, (snapshot.rear_x, snapshot.rear_y)))
    for step in range(6000):
        answer = driver.answer(snapshot, step * 0.025)
        for event in answer.events:
            assert event.status in (Status.ACTIVE, Status.QUEUED, Status.REACHED), event
            if event.status is Status.REACHED and event.goal.point == goal:
                off = float(heading_to_yaw(snapshot.heading)) - heading
                return abs(float(wrap_angle(off)))
        snapshot = simulator.step(answer.command)
    raise AssertionError(f"did not reach {goal}")


@pytest.mark.parametrize(("policy", "most"), [("fixed-speed", 20.0), ("lqr", 40.0)])
def test_rides_arrive_in_the_direction_asked_for(policy: str, most: float) -> None:
    rng = np.random.default_rng(5)
    off = [arrival(policy, rng) for _ in range(2)]
    assert np.degrees(max(off)) < most
