"""Controllers of one's own over the real simulator: as a node, as a class, as an ONNX file."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from bicycle_msgs.msg import GoalStatus
from node_process import NodeProcess
from probe import Probe, goal

from bicycle_common.nodes.topics import COMMAND_ECHO, GOAL_POSE, GOAL_STATUS, STATE
from bicycle_controller.policy.export import save_onnx
from bicycle_controller.policy.policy import load_policy

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("no_new_shared_memory")]

SIM = "bicycle_sim.nodes.sim_node"
CONTROLLER = "bicycle_controller.nodes.controller_node"
EXAMPLES = Path(__file__).resolve().parents[2] / "ros2_ws" / "src" / "examples"
IMPORTABLE = {"PYTHONPATH": f"{EXAMPLES}:{os.environ.get('PYTHONPATH', '')}"}
StartNode = Callable[..., NodeProcess]


@pytest.fixture
def probe(ros_domain: int) -> Iterator[Probe]:
    probe = Probe(ros_domain, STATE, COMMAND_ECHO, GOAL_STATUS)
    yield probe
    probe.close()


def start_simulator(start_node: StartNode) -> None:
    start_node(SIM, ["--ros-args", "-p", "pace:=lockstep"]).wait_for_line("episode 1 waits")


def test_the_example_of_a_node_rides_to_its_goal(start_node: StartNode, probe: Probe) -> None:
    source = (EXAMPLES / "own_controller.py").read_text().splitlines()
    assert sum(bool(line.strip()) for line in source) <= 30
    start_simulator(start_node)
    start_node("own_controller", env=IMPORTABLE)

    def arrived() -> bool:
        if not probe[STATE]:
            return False
        where = probe[STATE][-1].rear_contact
        return math.dist((where.x, where.y), (20.0, 10.0)) < 1.0

    probe.spin_until(arrived)
    assert not any(state.fallen for state in probe[STATE])
    assert probe[COMMAND_ECHO][-1].command.controller == "own_controller"


@pytest.mark.parametrize("kind", ["class", "onnx"])
def test_ones_own_has_goals_and_their_status(
    start_node: StartNode, probe: Probe, tmp_path: Path, kind: str
) -> None:
    policy, name = "own_policy:Steer", "pd@1"
    if kind == "onnx":
        policy, name = str(tmp_path / "mine.onnx"), "fixed-speed@"
        save_onnx(load_policy("fixed-speed"), Path(policy))
    start_simulator(start_node)
    words = ["--ros-args", "-p", f"policy:={policy}"]
    node = start_node(CONTROLLER, words, IMPORTABLE)
    node.wait_for_line("waits for a goal")
    assert name in node.output
    probe.say(GOAL_POSE, goal(20.0, 10.0))
    probe.spin_until(lambda: probe[GOAL_STATUS] and probe[GOAL_STATUS][-1].status == 2)
    assert probe[GOAL_STATUS][-1].status == GoalStatus.REACHED
    assert not any(state.fallen for state in probe[STATE])
