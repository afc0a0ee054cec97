"""A whole ride: three processes, a bag, its summary, picture and verification."""

from __future__ import annotations

import json
import os
import re
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from bicycle_msgs.msg import BicycleCommand, BicycleState
from domains import claimed_domain
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from node_process import NodeProcess
from probe import Probe, goal
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.highlevel import AnyReader
from waiting import until

from bicycle_bag.reader import BagReader
from bicycle_bag.writer import BagWriter
from bicycle_bringup.nodes.ride import longest_wait
from bicycle_common.nodes import topics
from bicycle_common.nodes.topics import Service
from bicycle_controller.policy.policy import load_controller
from bicycle_sim.plants import registry
from bicycle_tools.nodes import ride_recording, verify_states
from bicycle_tools.ride_log import COMMAND, STATE, read_ride

pytestmark = [pytest.mark.ros, pytest.mark.slow]

RIDE = Path(__file__).resolve().parents[2] / "ros2_ws" / "ride.sh"
NEAR = ("--goals", "3", "--field", "20", "--seed", "1", "controller.policy:=lqr")
MANY = ("--goals", "10", *NEAR[2:])
"""More goals than can be reached before the test has seen the first, on a busy machine too."""
ENDLESS = ("--minutes", "1000", *NEAR[2:])
LOCKSTEP = "simulator.pace:=lockstep"
Start = Callable[..., NodeProcess]


def pid_of(name: str, domain: int) -> int:
    """Return the pid of one of the ride's processes."""
    (note,) = (RIDE.parent / "runs" / "pids" / str(domain)).glob(f"{name}.*")
    return int(note.suffix[1:])


@pytest.fixture(scope="module")
def ridden(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[NodeProcess, Path]]:
    """Yield one ride in lock-step to its end, and its folder."""
    folder = tmp_path_factory.mktemp("ride") / "run"
    words = [str(RIDE), *NEAR, LOCKSTEP, "--output", str(folder)]
    with claimed_domain() as domain, NodeProcess(words, {"ROS_DOMAIN_ID": str(domain)}) as ride:
        ride.wait()
        yield ride, folder


def test_it_reaches_all_goals_and_says_so(ridden: tuple[NodeProcess, Path]) -> None:
    ride, folder = ridden
    assert ride.wait() == 0, ride.output
    assert [line.split(" at")[0] for line in ride.lines[:3]] == ["goal 1", "goal 2", "goal 3"]
    assert "3 of 3 reached" in ride.output
    assert str(folder) in ride.lines[-1]
    assert len(ride.lines) < 24


def test_it_leaves_a_bag_a_picture_and_numbers(ridden: tuple[NodeProcess, Path]) -> None:
    _, folder = ridden
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["goals"], summary["reached"], summary["falls"]) == (3, 3, 0)
    assert 1.0 <= summary["path_ratio"] < 5.0
    assert summary["loop"]["lockstep"] is True
    assert summary["loop"]["lost_steps"] == 0
    assert summary["events"] == []
    assert (folder / "ride.png").read_bytes().startswith(b"\x89PNG")
    for name in ("simulator", "controller", "recorder"):
        assert "Traceback" not in (folder / f"{name}.log").read_text()


def test_others_read_the_bag_and_count_the_same(ridden: tuple[NodeProcess, Path]) -> None:
    bag = ridden[1] / "bag"
    own = BagReader(bag).counts
    with AnyReader([bag]) as reader:
        foreign = {topic: info.msgcount for topic, info in reader.topics.items()}
        decoded = sum(1 for c, _, raw in reader.messages() if reader.deserialize(raw, c.msgtype))
    assert foreign == own
    assert decoded == sum(own.values())
    counted = dict.fromkeys(own, 0)
    for file in bag.glob("*.mcap"):
        with file.open("rb") as stream:
            messages = make_reader(stream, decoder_factories=[DecoderFactory()])
            for _, channel, _, _ in messages.iter_decoded_messages():
                counted[channel.topic] += 1
    assert counted == own


def test_every_state_comes_out_again(ridden: tuple[NodeProcess, Path]) -> None:
    recording = ride_recording.read(ridden[1] / "bag")
    (*_, verdict) = verify_states.verify(recording)
    assert verdict.proved, verdict
    assert verdict.begun == 1
    assert verdict.checked + verdict.begun == len(read_ride(ridden[1] / "bag").states["step"])


def test_its_folder_becomes_a_page(
    ridden: tuple[NodeProcess, Path], start_node: Start, tmp_path: Path
) -> None:
    target = tmp_path / "page.html"
    process = start_node(RIDE.parent / "report.sh", [ridden[1], "--output", target])
    assert process.wait() == 0, process.output
    assert process.lines[-1] == str(target)
    page = target.read_text()
    assert "3 of 3 goals reached" in page
    assert page.count(">reached</span>") == 3
    assert "not whole" not in page


def changed(bag: Path, target: Path, step: int, torque: float | None) -> None:
    """Copy a bag with one command's torque changed, or without that command."""
    reader = BagReader(bag)
    with BagWriter(target) as writer:
        for topic in reader.topics.values():
            writer.add_topic(topic, reader.definition(topic.name))
        for item in reader.messages():
            data = item.data
            if item.topic == COMMAND:
                command = deserialize_message(data, BicycleCommand)
                if command.step == step and torque is None:
                    continue
                if command.step == step:
                    command.torque = torque
                    data = serialize_message(command)
            writer.write(item.topic, data, item.log_time_ns, item.publish_time_ns)


def verified(bag: Path, start_node: Start) -> tuple[int, str]:
    process = start_node(RIDE.parent / "replay.sh", ["--verify", bag])
    return process.wait(), process.lines[-1]


def test_a_forged_command_is_found(
    ridden: tuple[NodeProcess, Path], start_node: Start, tmp_path: Path
) -> None:
    changed(ridden[1] / "bag", tmp_path / "forged", step=40, torque=0.125)
    status, line = verified(tmp_path / "forged", start_node)
    assert status == 1
    assert "not the same after 40 equal states: step 41 of episode 1: steer_" in line
    assert "apart" in line


def test_a_missing_command_is_not_hidden(
    ridden: tuple[NodeProcess, Path], start_node: Start, tmp_path: Path
) -> None:
    changed(ridden[1] / "bag", tmp_path / "short", step=40, torque=None)
    status, line = verified(tmp_path / "short", start_node)
    assert status == 1
    assert "not proved" in line
    assert "1 could not be computed" in line
    assert "first step 41 of episode 1" in line


def test_a_forged_echo_is_found(ridden: tuple[NodeProcess, Path]) -> None:
    """The echo must say what was sent."""
    recording = ride_recording.read(ridden[1] / "bag")
    ((_, echo),) = recording.echoes[1, 41]
    echo.command.goal.x += 1.0
    (*_, verdict) = verify_states.verify(recording)
    assert "step 41 of episode 1: echo.command.goal.x was" in verdict.difference


def begun_later(bag: Path, target: Path, state: int, command: int) -> None:
    """Copy a bag as a recorder would have made it that heard states and commands from then on."""
    reader = BagReader(bag)
    begins = {STATE: (BicycleState, state), COMMAND: (BicycleCommand, command)}
    with BagWriter(target) as writer:
        for topic in reader.topics.values():
            writer.add_topic(topic, reader.definition(topic.name))
        for item in reader.messages():
            kind, first = begins.get(item.topic, (None, 0))
            if kind is None or deserialize_message(item.data, kind).step >= first:
                writer.write(item.topic, item.data, item.log_time_ns, item.publish_time_ns)


@pytest.mark.parametrize(("state", "command"), [(40, 40), (40, 45), (0, 1)])
def test_a_recording_that_began_in_mid_ride_is_proved_from_there(
    ridden: tuple[NodeProcess, Path], start_node: Start, tmp_path: Path, state: int, command: int
) -> None:
    begun_later(ridden[1] / "bag", tmp_path / "late", state, command)
    last = int(read_ride(ridden[1] / "bag").states["step"][-1])
    said = (
        f"{last - command} states came out again, bit for bit, from where the recording begins: "
        f"step {command} of episode 1"
    )
    if command > state:
        said += f" ({command - state} states up to it came under commands that the bag lacks)"
    assert verified(tmp_path / "late", start_node) == (0, f"{tmp_path / 'late'}: {said}")


def test_a_recording_without_commands_is_not_proved(
    ridden: tuple[NodeProcess, Path], start_node: Start, tmp_path: Path
) -> None:
    begun_later(ridden[1] / "bag", tmp_path / "none", 0, 10**6)
    status, line = verified(tmp_path / "none", start_node)
    assert status == 1
    assert "not proved: the bag holds none of the commands that led to its states" in line


def test_a_controller_killed_on_the_way_is_reported(
    start_node: Start, ros_domain: int, tmp_path: Path
) -> None:
    ride = start_node(RIDE, [*MANY, LOCKSTEP, "--output", tmp_path / "run"])
    ride.wait_for_line("goal 1 at")
    os.kill(pid_of("controller", ros_domain), signal.SIGKILL)
    assert ride.wait() == 0, ride.output
    events = json.loads((tmp_path / "run" / "summary.json").read_text())["events"]
    assert len(events) == 2
    assert events[0].startswith("controller was killed by SIGKILL at t = ")
    assert events[1].startswith("controller started again, ready at t = ")
    # The recorder may lack the end that the controller told as it was killed.
    assert sum(": reached after" in line for line in ride.lines) == 10
    assert re.search(r"10 of 10 reached|9 of 10 reached, 1 without an end in the bag", ride.output)


def test_goals_that_another_node_replaced_are_sent_again(
    start_node: Start, ros_domain: int, tmp_path: Path
) -> None:
    ride = start_node(RIDE, [*MANY, LOCKSTEP, "--output", tmp_path / "run"])
    ride.wait_for_line("goal 1 at")
    probe = Probe(ros_domain)
    probe.say(topics.GOAL_POSE, goal(0.0, 0.0))
    probe.close()
    assert ride.wait() == 0, ride.output
    assert sum(": reached after" in line for line in ride.lines) == 10


def test_goals_that_are_rejected_are_sent_again(
    start_node: Start, ros_domain: int, tmp_path: Path
) -> None:
    words = [*NEAR, LOCKSTEP, "controller.managed:=true", "--output", tmp_path / "run"]
    ride = start_node(RIDE, words)
    ride.wait_for_line("the goals are sent again, for the controller is not active")
    probe = Probe(ros_domain)
    change = Service("bicycle_controller/change_state", ChangeState)
    for number in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
        request = ChangeState.Request(transition=Transition(id=number))
        assert probe.call(change, request).success
    probe.close()
    assert ride.wait() == 0, ride.output
    assert "3 of 3 reached" in ride.output


def test_a_policy_that_rides_another_bicycle_than_it_was_trained_on_is_warned_of(
    start_node: Start, tmp_path: Path
) -> None:
    words = ["--goals", "1", "simulator.physics:=corrected", "simulator.pace:=lockstep"]
    ride = start_node(RIDE, [*words, "--output", tmp_path / "run"])
    assert ride.wait() in (0, 3, 4), ride.output
    ride.wait_for_line("event .*fixed-speed@.* was made for another ride")
    events = json.loads((tmp_path / "run" / "summary.json").read_text())["events"]
    assert any("gyroscopic_correction true, not false" in event for event in events)


def test_a_real_bicycle_is_ridden_and_proved(start_node: Start, tmp_path: Path) -> None:
    """A Whipple bicycle under an LQR of its own model; the bag gives every bit of its state."""
    words = ["simulator.plant:=whipple", "simulator.bicycle:=browser-rider", LOCKSTEP]
    ride = start_node(RIDE, [*NEAR, *words, "--output", tmp_path / "run"])
    assert ride.wait() in (0, 4), ride.output  # one goal in some seventy is circled, not reached
    assert re.search(r"falls +0\b", ride.output), ride.output
    found = json.loads((tmp_path / "run" / "summary.json").read_text())
    plant = registry.named("whipple", "browser-rider")
    assert load_controller("lqr", plant).policy_id in json.dumps(found)
    assert not any("another ride" in event for event in found["events"])
    (*_, verdict) = verify_states.verify(ride_recording.read(tmp_path / "run" / "bag"))
    assert verdict.proved, verdict


def test_the_actor_for_any_bicycle_rides_a_real_one(start_node: Start, tmp_path: Path) -> None:
    """It is told nothing of the bicycle, remembers the ride, and no other controller steps in."""
    words = ["simulator.plant:=whipple", "simulator.bicycle:=browser-rider", LOCKSTEP]
    words += ["controller.policy:=any-bicycle"]
    ride = start_node(RIDE, [*NEAR, *words, "--output", tmp_path / "run"])
    assert ride.wait() in (0, 4), ride.output
    assert re.search(r"falls +0\b", ride.output), ride.output
    found = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert "any-bicycle@" in json.dumps(found)
    assert not any("another ride" in event for event in found["events"])
    assert not any("takes over" in event for event in found["events"])
    (*_, verdict) = verify_states.verify(ride_recording.read(tmp_path / "run" / "bag"))
    assert verdict.proved, verdict


def test_without_respawn_a_dead_controller_ends_the_ride(
    start_node: Start, ros_domain: int, tmp_path: Path
) -> None:
    ride = start_node(RIDE, [*ENDLESS, LOCKSTEP, "--no-respawn", "--output", tmp_path / "run"])
    ride.wait_for_line("goal 1 at")
    os.kill(pid_of("controller", ros_domain), signal.SIGKILL)
    assert ride.wait() == 1
    assert "ride.sh: controller was killed by SIGKILL at t = " in ride.output
    # What a killed process told last may reach one subscriber and not the other.
    assert re.search(r"\d+ of \d+ reached", ride.output), ride.output


def test_the_first_step_is_given_longer_than_the_others() -> None:
    """A controller designs for its bicycle for two seconds, of which a busy machine makes many."""
    assert longest_wait(0) == 90.0
    assert longest_wait(1) == longest_wait(10_000) == 20.0


def test_an_interrupt_still_gives_the_summary(
    start_node: Start, ros_domain: int, tmp_path: Path
) -> None:
    far = ("--goals", "3", "--field", "2000", *NEAR[4:])
    ride = start_node(RIDE, [*far, "--output", tmp_path / "run"])

    def ridden() -> bool:
        assert ride.running, ride.output
        bags = (tmp_path / "run" / "bag").glob("*.mcap")
        return any(bag.stat().st_size > 50_000 for bag in bags)

    until(ridden)
    assert ride.stop(signal.SIGINT) == 130, ride.output
    assert "0 of 3 reached" in ride.output
    assert "Hz, real time" in ride.output
    assert BagReader(tmp_path / "run" / "bag").message_count > 0
    notes = [note.stem for note in (RIDE.parent / "runs" / "pids" / str(ros_domain)).iterdir()]
    assert not {"simulator", "controller", "recorder"} & set(notes)


def test_a_wrong_parameter_names_the_process_and_its_log(
    start_node: Start, tmp_path: Path
) -> None:
    ride = start_node(RIDE, ["controller.policy:=/none.safetensors", "--output", tmp_path / "run"])
    assert ride.wait() == 1
    # A machine that has much else to do may have a recorder to wait for, which is told too.
    (line,) = (one for one in ride.lines if "controller exited with status 2" in one)
    assert "while starting" in line
    assert "/none.safetensors" in line
    assert str(tmp_path / "run" / "controller.log") in line


def test_a_busy_domain_is_refused(start_node: Start, ros_domain: int, tmp_path: Path) -> None:
    start_node(RIDE.parent / "sim.sh").wait_for_line("waits for its first command")
    ride = start_node(RIDE, [*NEAR, "--output", tmp_path / "run"])
    assert ride.wait() == 1
    assert ride.lines == [
        f"ride.sh: ROS_DOMAIN_ID={ros_domain} is taken by bicycle_sim: stop.sh ends what this "
        "workspace runs, or choose another ROS_DOMAIN_ID"
    ]
