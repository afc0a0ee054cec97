"""A replay beside nodes that publish the same topics, and what steers one while it runs."""

from __future__ import annotations

import os
import pty
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from bicycle_msgs.msg import GoalStatus
from node_process import NodeProcess
from probe import Probe, goal
from std_srvs.srv import Trigger
from test_scripts import script
from waiting import PATIENCE

from bicycle_common.nodes.topics import COMMAND, GOAL_POSE, GOAL_STATUS, STATE, Service
from bicycle_tools.ride_log import read_ride

pytestmark = [pytest.mark.ros, pytest.mark.slow]

Start = Callable[..., NodeProcess]
WORKSPACE = Path(__file__).resolve().parents[2] / "ros2_ws"
BAG = Path(__file__).parents[1] / "data" / "ride-0.1.0"
"""0.5 s of a ride, 804 messages of 11 topics."""
FROM_BAG = ("--remap", *(f"{name}:=/ghost{name}" for name in ("/bicycle/state", "/odom")))


@pytest.fixture
def replay(start_node: Start) -> Start:
    return lambda *words: start_node(WORKSPACE / "replay.sh", [BAG, *words])


@pytest.fixture
def probe(ros_domain: int) -> Iterator[Probe]:
    result = Probe(ros_domain, STATE, GOAL_STATUS)
    yield result
    result.close()


@pytest.fixture
def simulator(start_node: Start) -> NodeProcess:
    result = start_node(WORKSPACE / "sim.sh", [])
    result.wait_for_line("waits for its first command")
    return result


def refused(process: NodeProcess, *nodes: str) -> None:
    """Check that a replay ended with one line that names nodes and the remedy."""
    assert process.wait() == 1, process.output
    line = process.lines[-1]
    for word in (*nodes, "stop.sh", "ROS_DOMAIN_ID", "--exclude-topics", "--remap"):
        assert word in line
    assert "Traceback" not in process.output


def test_what_others_publish_is_not_played(simulator: NodeProcess, replay: Start) -> None:
    done = replay()
    refused(done, "/bicycle_sim (/bicycle/command_echo and ")
    assert "playing" not in done.output, "it is told before the first message"
    # What the simulator does not publish, and other names, may be played.
    assert replay("--topics", "/bicycle/goal_status").wait() == 0
    only = ("--topics", "/bicycle/state", "/odom")
    assert replay(*only, *FROM_BAG).wait() == 0
    refused(replay(*only), "/bicycle_sim (/bicycle/command_echo and 2 more)")
    refused(replay("--topics", "/odom", "--remap", "/odom:=/bicycle/state"), "/bicycle_sim")
    assert simulator.running
    assert "ignored" not in simulator.output


def test_a_controller_alone_is_not_ridden_by_a_bag(start_node: Start, replay: Start) -> None:
    start_node(WORKSPACE / "controller.sh", ["policy:=lqr"]).wait_for_line("waits for a goal")
    refused(replay(), "/bicycle_controller (/bicycle/")


def test_a_goal_is_not_reached_by_the_states_of_a_bag(
    start_node: Start, probe: Probe, replay: Start
) -> None:
    """Other programs play a bag beside a controller, and refuse nothing."""
    controller = start_node(WORKSPACE / "controller.sh", ["policy:=lqr"])
    controller.wait_for_line("waits for a goal")
    commands: list[Any] = []
    probe.node.create_subscription(COMMAND.type, COMMAND.name, commands.append, 1000)
    states = read_ride(BAG).states
    x, y = (float(states[f"rear_contact.{axis}"][-10]) for axis in "xy")
    probe.say(GOAL_POSE, goal(x, y))
    running = replay("--topics", "/bicycle/state", "--start-offset", "0.25", "--delay", "2")
    assert running.wait() == 0, running.output
    probe.spin_until(lambda: len(probe[STATE]) > 5)
    probe.spin_until(lambda: probe[GOAL_STATUS])
    statuses = [(status.status, status.message) for status in probe[GOAL_STATUS]]
    assert [status for status, _ in statuses] == [GoalStatus.QUEUED]
    assert "drives the bicycle" in statuses[0][1]
    assert commands == []


def test_a_stack_that_starts_while_a_replay_runs_is_not_disturbed(
    start_node: Start, replay: Start
) -> None:
    """The simulator refuses to be a second one; for a controller the replay ends."""
    running = replay("--loop")
    running.wait_for_line("playing")
    simulator = start_node(WORKSPACE / "sim.sh", [])
    assert simulator.wait() == 2
    assert "(bicycle_player) publishes /bicycle/state" in simulator.lines[-1]
    assert running.running
    start_node(WORKSPACE / "controller.sh", ["policy:=lqr"]).wait_for_line("waits for a goal")
    refused(running, "/bicycle_controller")


def test_a_second_replay_is_refused(replay: Start) -> None:
    first = replay("--loop")
    first.wait_for_line("playing")
    refused(replay(), "/bicycle_player")
    assert first.running
    assert first.stop() == 0


def test_a_viewer_that_may_send_goals_does_not_hinder_a_replay(
    probe: Probe, replay: Start
) -> None:
    probe.node.create_publisher(GOAL_POSE.type, GOAL_POSE.name, GOAL_POSE.publish)
    assert replay("--topics", "/goal_pose", "/rosout").wait() in (0, 1)
    assert "published by" not in replay().output


def test_a_replay_is_held_stepped_and_let_go_by_services(probe: Probe, replay: Start) -> None:
    running = replay("--pause", "--topics", "/bicycle/state", "--delay", "0")
    running.wait_for_line("paused")

    def call(name: str) -> str:
        return str(
            probe.call(Service(f"/bicycle_player/{name}", Trigger), Trigger.Request()).message
        )

    # A state comes after the echo of the command that led to it.
    for _ in range(2):
        assert call("play_next") == "the next message is played"
    probe.spin_until(lambda: len(probe[STATE]) == 1)
    probe.spin_for(0.6)
    assert len(probe[STATE]) == 1, "the bag lasts 0.5 s, and only one message was let pass"
    assert call("resume") == "goes on"
    assert running.wait() == 0, running.output
    probe.spin_until(lambda: len(probe[STATE]) > 10)
    steps = [message.step for message in probe[STATE]]
    assert steps == sorted(steps)


def test_services_answer_before_the_first_message(probe: Probe, replay: Start) -> None:
    running = replay("--delay", "80000", "--rate", "0.01")
    running.wait_for_line("playing")

    def call(name: str) -> tuple[bool, str]:
        answer = probe.call(Service(f"/bicycle_player/{name}", Trigger), Trigger.Request())
        return answer.success, answer.message

    assert call("play_next") == (False, "plays: pause it first")
    assert call("pause") == (True, "paused")
    assert call("play_next") == (True, "the next message is played")
    assert running.stop() == 0


def test_states_without_their_echoes_are_no_controllers_bicycle(
    start_node: Start, probe: Probe, replay: Start
) -> None:
    """Nothing tells the controller that another one drives them."""
    alone = ("--loop", "--delay", "0", "--topics", "/bicycle/state", "/odom")
    for words in (
        (*alone, "--exclude-topics", "/bicycle/command_echo"),
        (*alone, "--remap", "/bicycle/command_echo:=/ghost/echo"),
    ):
        running = replay(*words)
        running.wait_for_line("playing")
        controller = start_node(WORKSPACE / "controller.sh", ["policy:=lqr"])
        refused(running, "/bicycle_controller (/bicycle/command)")
        refused(replay(*words), "/bicycle_controller (/bicycle/command)")
        assert controller.stop() == 0


def test_keys_hold_a_replay_and_let_it_go(ros_domain: int, tmp_path: Path) -> None:
    """A terminal of its own, as a person has it."""
    child, terminal = pty.fork()
    if child == 0:  # pragma: no cover
        os.execv(WORKSPACE / "replay.sh", ["replay.sh", str(BAG), "--pause", "--loop"])
    printed = bytearray()

    def wait_for(text: bytes) -> None:
        deadline = time.monotonic() + PATIENCE
        while text not in printed:
            assert time.monotonic() < deadline, printed.decode()
            printed.extend(os.read(terminal, 4096))

    try:
        wait_for(b"Space pauses")
        os.write(terminal, b" ")
        wait_for(b"goes on")
        os.write(terminal, b"\x1b[A")
        wait_for(b"1.10 times the speed")
        del printed[:]
        os.write(terminal, b" ")
        wait_for(b"paused")
    finally:
        os.kill(child, signal.SIGINT)
        _, status = os.waitpid(child, 0)
        os.close(terminal)
    assert os.waitstatus_to_exitcode(status) == 0


def test_parts_of_a_bag_are_played(probe: Probe, replay: Start) -> None:
    done = replay("--exclude-topics", "/odom", "bicycle/timing", "--playback-duration", "0.2")
    assert done.wait() == 0
    done.wait_for_line(r"playing .*: 0\.2 s")
    done.wait_for_line(r"played \d+ messages of 10 topics")


def test_a_file_of_qos_profiles_is_obeyed(probe: Probe, replay: Start, tmp_path: Path) -> None:
    (tmp_path / "qos.yaml").write_text("/bicycle/state: {reliability: best_effort, depth: 3}\n")
    running = replay("--qos-profile-overrides-path", tmp_path / "qos.yaml", "--pause")
    running.wait_for_line("paused")

    def offers() -> list[str]:
        ends = probe.node.get_publishers_info_by_topic("/bicycle/state")
        return [end.qos_profile.reliability.name for end in ends]

    assert probe.spin_until(offers) == ["BEST_EFFORT"]
    assert running.stop() == 0


@pytest.mark.parametrize(
    ("words", "status", "complaint"),
    [
        (("--remap", "/odom"), 2, "'/odom' does not rename a topic: write /odom:=/ghost/odom"),
        (("--remap", "/odim:=/a"), 1, "has no topic /odim"),
        (("--remap", "/odom:=a b"), 2, "does not rename a topic"),
        (("--exclude-topics", "/odim"), 1, "has no topic /odim"),
        (("--playback-duration", "-1"), 2, "playback duration is -1"),
        (("--qos-profile-overrides-path", "/none.yaml"), 2, "cannot read /none.yaml"),
        (("--remap", "/odom:=/bicycle/state"), 1, "would both be /bicycle/state: give them"),
        (("--topics", "/odom", "--remap", "/odom:=/clock", "--clock"), 1, "would both be /clock"),
        (("--topics", "/odom", "--exclude-topics", "odom"), 1, "has no message to play"),
    ],
)
def test_a_mistake_is_one_line(
    words: tuple[str, ...], status: int, complaint: str, ros_domain: int
) -> None:
    done = script("replay", BAG, *words)
    assert (done.returncode, done.stdout) == (status, "")
    assert done.stderr.startswith("replay.sh: ")
    assert complaint in done.stderr
    assert done.stderr.count("\n") == 1


def test_goal_of_a_live_bicycle_is_not_reached_by_a_bag(
    start_node: Start, probe: Probe, simulator: NodeProcess, replay: Start
) -> None:
    """The bag's states once made "reached after 0.0 s and 0.0 m", and the bicycle fall."""
    start_node(WORKSPACE / "controller.sh", ["policy:=lqr"]).wait_for_line("waits for a goal")
    probe.say(GOAL_POSE, goal(300.0, 0.0))
    probe.spin_until(lambda: probe[GOAL_STATUS])
    refused(replay(), "/bicycle_controller", "/bicycle_sim")
    probe.spin_for(1.0)
    assert [status.status for status in probe[GOAL_STATUS]] == [1]
    assert not probe[STATE][-1].fallen
