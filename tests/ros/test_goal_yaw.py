"""`goal.sh --yaw`: a goal and the direction of arrival from the shell."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import pytest
from bicycle_msgs.msg import BicycleState
from node_process import NodeProcess
from probe import Probe

from bicycle_common.nodes.convert import arrival_of
from bicycle_common.nodes.topics import ACTIVE_GOAL, GOAL_STATUS, STATE

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("no_new_shared_memory")]


def has_ended(process: NodeProcess) -> bool:
    return not process.running


def test_goal_sh_arrives_in_the_direction_asked_for(
    start_node: Callable[..., NodeProcess], ros_domain: int
) -> None:
    sim = ["--ros-args", "-p", "pace:=lockstep", "-p", "scenario:=learned-speed"]
    start_node("bicycle_sim.nodes.sim_node", sim).wait_for_line("episode 1 waits")
    ride = ["--ros-args", "-p", "policy:=lqr-pedal", "-p", "after_goal:=slow"]
    controller = start_node("bicycle_controller.nodes.controller_node", ride)
    controller.wait_for_line("waits for a goal")
    probe = Probe(ros_domain, STATE, GOAL_STATUS, ACTIVE_GOAL)
    try:
        probe.spin_until(lambda: probe[STATE])
        # The first goal makes sure that the follower's gains are there.
        for words in (["30", "0", "--wait"], ["30", "20", "--yaw", "180", "--wait"]):
            sent = start_node("bicycle_tools.nodes.goal", words)
            probe.spin_until(partial(has_ended, sent))
            assert sent.wait() == 0, sent.output
        probe.spin_until(lambda: [s.status for s in probe[GOAL_STATUS]].count(2) >= 2)
        asked = [arrival_of(active.pose.orientation) for active in probe[ACTIVE_GOAL]]
        assert asked == [None, pytest.approx(math.pi)]

        def off(state: BicycleState) -> float:
            return math.hypot(state.rear_contact.x - 30.0, state.rear_contact.y - 20.0)

        # The states of a busy machine are heard after the word that the goal is reached.
        probe.spin_until(lambda: off(min(probe[STATE], key=off)) < 1.0)
        near = min(probe[STATE], key=off)
        assert abs(math.remainder(near.heading - math.pi, 2.0 * math.pi)) < math.radians(10.0)
        controller.wait_for_line("slows down to 2.0 m/s")
    finally:
        probe.close()
