"""Managed states of the controller, and parameters that change while it runs."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from nav_msgs.msg import Path
from node_process import NodeProcess
from probe import Probe, goal
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters

from bicycle_common.nodes import topics
from bicycle_common.nodes.topics import Service
from bicycle_controller.control.goals import Status
from bicycle_tools.nodes.commander import BicycleCommander

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("no_new_shared_memory")]

StartNode = Callable[..., NodeProcess]
CHANGE = Service("bicycle_controller/change_state", ChangeState)
STATE_OF = Service("bicycle_controller/get_state", GetState)
SET = Service("bicycle_controller/set_parameters", SetParameters)


def words(**values: object) -> list[str]:
    return ["--ros-args", *(w for n, v in values.items() for w in ("-p", f"{n}:={v}"))]


def value(given: float | str) -> ParameterValue:
    if isinstance(given, str):
        return ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=given)
    return ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=given)


def test_states_and_parameters(start_node: StartNode, ros_domain: int) -> None:
    sim = words(pace="lockstep", scenario="learned-speed")
    start_node("bicycle_sim.nodes.sim_node", sim).wait_for_line("episode 1 waits")
    node = start_node(
        "bicycle_controller.nodes.controller_node", words(policy="lqr-pedal", managed="true")
    )
    node.wait_for_line("waits to be configured and activated")
    probe = Probe(ros_domain, topics.STATE, topics.COMMAND, topics.GOAL_STATUS)

    def change(number: int) -> None:
        request = ChangeState.Request(transition=Transition(id=number))
        assert probe.call(CHANGE, request).success

    def state() -> Any:
        return probe.call(STATE_OF, GetState.Request()).current_state.id

    def set_to(name: str, given: float | str) -> Any:
        request = SetParameters.Request(parameters=[Parameter(name=name, value=value(given))])
        return probe.call(SET, request).results[0]

    try:
        assert state() == State.PRIMARY_STATE_UNCONFIGURED
        probe.say(topics.GOAL_POSE, goal(30.0, 5.0))
        probe.spin_until(lambda: bool(probe[topics.GOAL_STATUS]))
        refused = probe[topics.GOAL_STATUS][-1]
        assert (refused.status, "not active" in refused.message) == (Status.REJECTED, True)
        probe.say(topics.GOAL_PATH, Path())  # it has no first goal that could be refused
        probe.spin_until(lambda: len(probe[topics.GOAL_STATUS]) > 1)
        assert math.isnan(probe[topics.GOAL_STATUS][-1].position.x)
        change(Transition.TRANSITION_CONFIGURE)
        assert state() == State.PRIMARY_STATE_INACTIVE
        assert probe[topics.COMMAND] == []
        change(Transition.TRANSITION_ACTIVATE)
        node.wait_for_line("waits for a goal")
        probe.say(topics.GOAL_POSE, goal(300.0, 5.0))
        probe.spin_until(lambda: len(probe[topics.COMMAND]) > 5)

        # Some parameters change while it rides, and the others say why they do not.
        assert set_to("goal_radius", 30.0).successful
        fixed = set_to("policy", "lqr")
        assert not fixed.successful
        assert "bicycle/load_policy" in fixed.reason
        assert "restart the node with it" in set_to("state", "estimated").reason
        assert not set_to("path_speed", 9.0).successful
        assert "choose one up to path_speed" in set_to("path_slowest", 4.0).reason
        probe.spin_until(lambda: probe[topics.GOAL_STATUS][-1].status == Status.REACHED)
        assert 15.0 < probe[topics.GOAL_STATUS][-1].distance < 30.0

        with BicycleCommander() as bicycle:
            bicycle.ride_to(2000.0, 0.0)
            change(Transition.TRANSITION_DEACTIVATE)
            ended = bicycle.wait(timeout=60.0)
            assert not ended.reached
            assert "no longer active" in ended.message
        assert state() == State.PRIMARY_STATE_INACTIVE
    finally:
        probe.close()
