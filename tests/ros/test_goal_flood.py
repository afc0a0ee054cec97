"""A thousand goals in a second, sound and unsound ones: the bicycle rides on, to the last."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable

import pytest
from bicycle_msgs.msg import CommandEcho, GoalStatus
from geometry_msgs.msg import PoseStamped
from node_process import NodeProcess
from probe import Probe, goal
from waiting import PATIENCE

from bicycle_common.nodes.topics import COMMAND_ECHO, GOAL_POSE, GOAL_STATUS, STATE

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("no_new_shared_memory")]

RATE = 1000
SECONDS = 3
LAST = (30.0, -20.0)


def strange(number: int) -> PoseStamped:
    """Two of three goals are sound, each third is not."""
    angle = 0.1 * number
    place = (40.0 * math.cos(angle), 40.0 * math.sin(angle))
    if number % 3:
        return goal(*place)
    return goal(math.nan, place[1]) if number % 2 else goal(*place, frame="moon")


def flood(probe: Probe) -> None:
    """A thousand a second, and on until the bicycle has ridden for `SECONDS`."""
    publisher = probe.publisher(GOAL_POSE)
    begun, states = time.monotonic(), len(probe[STATE])
    for number in itertools.count():
        publisher.publish(strange(number))
        probe.executor.spin_once(timeout_sec=0.0)
        if number >= RATE * SECONDS and len(probe[STATE]) >= states + 40 * SECONDS:
            break
        assert time.monotonic() < begun + PATIENCE, "the bicycle does not ride on"
        time.sleep(max(0.0, begun + (number + 1) / RATE - time.monotonic()))


def place(echo: CommandEcho) -> tuple[float, float]:
    return echo.command.goal.x, echo.command.goal.y


def last(probe: Probe) -> GoalStatus:
    return probe[GOAL_STATUS][-1]


def test_a_flood_of_goals_does_not_stop_the_ride(
    start_node: Callable[..., NodeProcess], ros_domain: int
) -> None:
    # Where it may have no priority a busy machine keeps it waiting; goals must not.
    words = ["--ros-args", "-p", "watchdog_timeout:=5.0"]
    simulator = start_node("bicycle_sim.nodes.sim_node", words)
    simulator.wait_for_line("episode 1 waits")
    controller = start_node("bicycle_controller.nodes.controller_node")
    controller.wait_for_line("waits for a goal")
    probe = Probe(ros_domain, COMMAND_ECHO, STATE, GOAL_STATUS)
    try:
        probe.say(GOAL_POSE, goal(40.0, 0.0))
        probe.spin_until(lambda: probe[STATE] and probe[STATE][-1].step > 40)
        begun = len(probe[COMMAND_ECHO])
        flood(probe)
        probe.say(GOAL_POSE, goal(*LAST))
        probe.spin_until(lambda: place(probe[COMMAND_ECHO][-1]) == LAST)
        probe.spin_until(lambda: last(probe).status == GoalStatus.REACHED)
        assert (last(probe).position.x, last(probe).position.y) == LAST
        statuses = {one.status for one in probe[GOAL_STATUS]}
        assert {GoalStatus.REPLACED, GoalStatus.REJECTED, GoalStatus.ACTIVE} <= statuses
        sources = {one.command_source for one in probe[COMMAND_ECHO][begun:]}
        assert sources <= {CommandEcho.SOURCE_FRESH, CommandEcho.SOURCE_HELD}
        assert not probe[STATE][-1].fallen
    finally:
        probe.close()
    assert controller.running
    assert simulator.running
    assert "Traceback" not in controller.output
