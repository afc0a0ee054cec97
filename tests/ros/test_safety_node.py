"""The safety layer in the real controller, over the real simulator, under a policy gone wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from bicycle_msgs.msg import GoalStatus, HandOver
from diagnostic_msgs.msg import DiagnosticStatus
from node_process import NodeProcess
from probe import Probe, goal

from bicycle_bag.reader import BagReader
from bicycle_common.nodes.topics import (
    COMMAND,
    DIAGNOSTICS,
    GOAL_POSE,
    GOAL_STATUS,
    HAND_OVER,
    HAND_OVER_MARKERS,
    STATE,
)
from bicycle_controller.control.safety import HandOverReason
from bicycle_controller.nodes.hand_over_marks import WHERE
from bicycle_controller.policy.policy import Policy, load_policy, save_policy

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("no_new_shared_memory")]

SIM = "bicycle_sim.nodes.sim_node"
CONTROLLER = "bicycle_controller.nodes.controller_node"
StartNode = Callable[..., NodeProcess]


@pytest.fixture
def probe(ros_domain: int) -> Iterator[Probe]:
    result = Probe(ros_domain, STATE, GOAL_STATUS, HAND_OVER, HAND_OVER_MARKERS, DIAGNOSTICS)
    yield result
    result.close()


def test_the_reasons_are_the_message_s() -> None:
    for reason in HandOverReason:
        assert getattr(HandOver, reason.name) == reason


def full_torque(path: Path) -> Path:
    """Return the shipped actor with an output layer that always steers left with all it has."""
    sound = load_policy("fixed-speed")
    tensors = {name: tensor.copy() for name, tensor in sound.tensors.items()}
    last = max(name for name in tensors if name.startswith("layer.") and name.endswith(".bias"))
    tensors[last] = np.full_like(tensors[last], 100.0)
    save_policy(Policy(sound.info, tensors), path)
    return path


def start(start_node: StartNode, policy: Path, *more: str) -> None:
    start_node(SIM, ["--ros-args", "-p", "pace:=lockstep"]).wait_for_line("episode 1 waits")
    words = ["--ros-args", "-p", f"policy:={policy}", *more]
    start_node(CONTROLLER, words).wait_for_line("waits for a goal")


def test_under_a_policy_that_is_garbage_the_goal_is_reached_and_each_hand_over_told(
    start_node: StartNode, probe: Probe, tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    recorder = start_node("bicycle_bag.nodes.recorder_node", ["--output", bag])
    recorder.wait_for_line("recording into")
    start(start_node, full_torque(tmp_path / "garbage.safetensors"))
    # A step that the recorder does not hear cannot be computed again.
    for topic in (STATE, COMMAND):
        recorder.wait_for_line(f"recording /{topic.name}")
    probe.say(GOAL_POSE, goal(25.0, 10.0))
    probe.spin_until(lambda: probe[GOAL_STATUS] and probe[GOAL_STATUS][-1].status == 2)
    assert probe[GOAL_STATUS][-1].status == GoalStatus.REACHED
    assert not any(state.fallen for state in probe[STATE])
    switches = probe[HAND_OVER]
    assert [one.reason for one in switches[:2]] == [HandOver.EXTRAPOLATED_LEAN, HandOver.NONE]
    assert switches[0].policy.startswith("lqr-")
    assert switches[1].policy.startswith("fixed-speed@")
    assert "rad is beyond" in switches[0].message
    spots = [one for one in probe[HAND_OVER_MARKERS][-1].markers if one.ns == WHERE]
    assert len(spots[0].points) == len(switches[::2]), "one for each hand-over"
    assert [one.hand_overs for one in switches[::2]] == list(range(1, len(switches[::2]) + 1))
    facts = probe.spin_until(lambda: controller_facts(probe))
    assert int(facts["hand-overs"]) >= 1
    assert float(facts["policy p99 (ms)"]) > 0.0
    assert float(facts["answer p99 (ms)"]) > 0.0
    recorder.stop()
    assert BagReader(bag).topics["/bicycle/hand_over"].type == "bicycle_msgs/msg/HandOver"
    verified = start_node("bicycle_tools.nodes.verify", [bag])
    assert verified.wait() == 0, verified.output


def controller_facts(probe: Probe) -> dict[str, str]:
    """Return the counts of the controller's diagnostics after its warning of the fallback."""
    entries = [entry for array in probe[DIAGNOSTICS] for entry in array.status]
    mine = [entry for entry in entries if entry.name.startswith("bicycle_controller")]
    warned = [entry for entry in mine if entry.level == DiagnosticStatus.WARN]
    facts = [{one.key: one.value for one in entry.values} for entry in warned]
    return next((found for found in facts if int(found["hand-overs"]) > 0), {})


def test_by_parameter_the_bicycle_is_stopped_until_a_new_goal(
    start_node: StartNode, probe: Probe, tmp_path: Path
) -> None:
    start(start_node, full_torque(tmp_path / "garbage.safetensors"), "-p", "safety:=stop")
    probe.say(GOAL_POSE, goal(25.0, 10.0))
    probe.spin_until(lambda: probe[GOAL_STATUS] and probe[GOAL_STATUS][-1].status == 8)
    assert probe[GOAL_STATUS][-1].message == "the safety layer stops the bicycle"
    begun = probe[STATE][-1].step
    probe.spin_until(lambda: probe[STATE][-1].step > begun + 200)
    assert not probe[STATE][-1].fallen
    assert [one.stop for one in probe[HAND_OVER]] == [True]


def test_switched_off_the_same_policy_falls(
    start_node: StartNode, probe: Probe, tmp_path: Path
) -> None:
    start(start_node, full_torque(tmp_path / "garbage.safetensors"), "-p", "safety:=none")
    probe.say(GOAL_POSE, goal(25.0, 10.0))
    probe.spin_until(lambda: probe[STATE] and probe[STATE][-1].fallen)
    assert probe[HAND_OVER] == []
