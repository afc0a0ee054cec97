"""Just before the next state is due, the controller asks its policy once for nothing."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

import numpy as np
import pytest
import rclpy
from bicycle_msgs.msg import EpisodeInfo
from probe import goal

from bicycle_common.nodes import convert
from bicycle_common.types import InitialPose
from bicycle_controller.control import control_loop
from bicycle_controller.nodes.controller_node import ControllerNode
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named

pytestmark = pytest.mark.ros

SCENARIO = named("random-start-random-goal")


class Counting:
    """A policy that counts how often it is asked."""

    policy_id = "counting"

    def __init__(self) -> None:
        self.asked = 0

    def act(self, observation: np.ndarray, speed: np.ndarray) -> np.ndarray:
        self.asked += 1
        return np.zeros((1, 3))


@pytest.fixture
def controller(ros_domain: int) -> Iterator[ControllerNode]:
    rclpy.init(args=["test", "--ros-args", "-p", "realtime_priority:=0"], domain_id=ros_domain)
    result = ControllerNode()
    yield result
    result.destroy_node()
    rclpy.try_shutdown()


@pytest.mark.parametrize(("pace", "asked"), [("realtime", 2), ("lockstep", 1)])
def test_once_after_each_answer_in_real_time(
    controller: ControllerNode, pace: str, asked: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(control_loop, "QUICK", math.inf)
    policy = controller._loop.policy = Counting()
    info = EpisodeInfo(episode=1, pace=pace, scenario=SCENARIO.to_json(), version="test")
    info.physics = ChoiPlant().to_json()
    controller._on_episode(info)
    controller._goals._on_goal_pose(goal(20.0, 10.0))
    simulator = Simulator(SCENARIO)
    simulator.reset(InitialPose(0.0, 0.0, 0.0, SCENARIO.start_speed))
    for step in range(3):
        controller._on_state(convert.from_snapshot(simulator.snapshot, 25_000_000 * step))
        simulator.step(controller._loop._command)
        while policy.asked < (step + 1) * asked:  # pytest ends a wait for ever
            rclpy.spin_once(controller, timeout_sec=0.01)
        # Long enough for two: without a state between, one is made.
        end = time.monotonic() + 0.1
        while time.monotonic() < end:
            rclpy.spin_once(controller, timeout_sec=0.01)
        assert policy.asked == (step + 1) * asked
