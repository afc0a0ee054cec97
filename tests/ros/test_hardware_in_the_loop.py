"""`ride.sh --hardware-in-the-loop`: from sensors only, through the simulated microcontroller."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bicycle_msgs.msg import DriverState
from conftest import StartNode
from domains import claimed_domain
from node_process import NodeProcess
from probe import Probe, goal
from rclpy.serialization import deserialize_message

from bicycle_bag.reader import BagReader
from bicycle_common.nodes import topics

pytestmark = [pytest.mark.ros, pytest.mark.slow]

RIDE = Path(__file__).resolve().parents[2] / "ros2_ws" / "ride.sh"
WORDS = ("--hardware-in-the-loop", "--goals", "1", "--field", "40", "--seed", "1")


@pytest.fixture(scope="module")
def ridden(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[NodeProcess, Path]]:
    """Yield one ride to its end, and its folder."""
    folder = tmp_path_factory.mktemp("ride") / "run"
    words = [str(RIDE), *WORDS, "--output", str(folder)]
    with claimed_domain() as domain, NodeProcess(words, {"ROS_DOMAIN_ID": str(domain)}) as ride:
        ride.wait()
        yield ride, folder


def messages(folder: Path, topic: topics.Topic) -> list[Any]:
    """Messages of a topic of the ride's bag."""
    found = BagReader(folder / "bag").messages([f"/{topic.name.lstrip('/')}"])
    return [deserialize_message(one.data, topic.type) for one in found]


def test_it_reaches_its_goal(ridden: tuple[NodeProcess, Path]) -> None:
    ride, _ = ridden
    assert ride.wait() == 0, ride.output
    assert "1 of 1 reached" in ride.output
    assert "commands came out again from the recorded sensors, bit for bit" in ride.output


def test_nothing_moves_before_the_board_is_armed(ridden: tuple[NodeProcess, Path]) -> None:
    _, folder = ridden
    states = messages(folder, topics.DRIVER_STATE)
    modes = list(dict.fromkeys(state.mode for state in states))
    assert modes[0] == DriverState.MODE_DISARMED
    assert modes[-1] == DriverState.MODE_RIDING
    assert DriverState.MODE_FALLBACK not in modes
    assert {s.torque for s in states if s.mode == DriverState.MODE_DISARMED} == {0.0}
    echoes = messages(folder, topics.COMMAND_ECHO)
    first = min(e.step for e in echoes if e.command_source == 1)
    assert first > 40  # commands came for a second before
    states = messages(folder, topics.STATE)
    start = states[0].rear_contact
    still = [s for s in states if s.step < first]
    assert {(s.rear_contact.x, s.rear_contact.y) for s in still} == {(start.x, start.y)}
    assert {e.command_source for e in echoes if e.step >= first} == {1}


def test_the_estimate_is_near_the_truth(ridden: tuple[NodeProcess, Path]) -> None:
    _, folder = ridden
    true = {(m.episode, m.step): m for m in messages(folder, topics.STATE)}
    estimates = messages(folder, topics.ESTIMATE)
    errors = [
        m.lean_angle - true[m.episode, m.step].lean_angle
        for m in estimates
        if m.step > 80 and (m.episode, m.step) in true
    ]
    assert len(errors) > 100
    assert math.degrees(float(np.sqrt(np.mean(np.square(errors))))) < 0.5


def test_the_diagnostics_tell_the_commands_age_at_the_board(
    ridden: tuple[NodeProcess, Path],
) -> None:
    _, folder = ridden
    reports = [
        {value.key: value.value for value in entry.values}
        for array in messages(folder, topics.DIAGNOSTICS)
        for entry in array.status
        if entry.name == "bicycle_sim: microcontroller"
    ]
    name = "period to command at the board"
    median, late = (float(reports[-1][f"{name} p{part} (ms)"]) for part in (50, 99))
    assert 0.0 < median < late
    log = (folder / "simulator.log").read_text()
    assert "commands when they reached the board: median" in log


def test_it_rides_as_a_real_bicycle_would_without_a_simulator_s_state(
    start_node: StartNode, ros_domain: int, tmp_path: Path
) -> None:
    """The estimate takes the state's place, as docs/real-bicycle.md says."""
    port, sensors = f"port:={tmp_path / 'board'}", "sensors:=mpu6050-rtk"
    alike = ["--ros-args", "-p", port, "-p", sensors, "-p", "bicycle:=browser-rider"]
    alike += ["-p", "pace:=lockstep", "-p", "plant:=whipple"]
    start_node(
        "bicycle_hardware.nodes.bench_node", [*alike, "-r", "bicycle/state:=bicycle/truth"]
    ).wait_for_line("serial line is")
    words = ["--ros-args", "-p", "state:=estimated", "-p", sensors, "-p", "policy:=lqr"]
    controller = start_node(
        "bicycle_controller.nodes.controller_node",
        [*words, "-r", "bicycle/estimate:=bicycle/state"],
    )
    controller.wait_for_line("waits for a goal")
    probe = Probe(ros_domain, topics.STATE, topics.DRIVER_STATE)
    try:
        start_node(
            "bicycle_hardware.nodes.driver_node",
            [*alike, "-p", "clock:=board", "-p", "arm_when_ready:=true"],
        )
        probe.spin_until(lambda: probe[topics.STATE])
        probe.say(topics.GOAL_POSE, goal(30.0, 5.0))
        probe.spin_until(lambda: probe[topics.STATE][-1].rear_contact.x > 5.0)
        assert all(state.estimated for state in probe[topics.STATE])
        assert probe[topics.DRIVER_STATE][-1].mode == DriverState.MODE_RIDING
    finally:
        probe.close()


def test_it_leaves_what_else_was_compiled(
    start_node: StartNode, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    other = tmp_path / "bicycle" / "native-0.so"
    other.parent.mkdir()
    other.write_bytes(b"a library that a training uses")
    words = ("-p", "plant:=whipple", "-p", "sensors:=mpu6050")
    bench = start_node("bicycle_hardware.nodes.bench_node", ["--ros-args", *words])
    bench.wait_for_line("serial line is")
    assert other.exists()
    assert len(list(other.parent.iterdir())) == 2


def test_parameters_of_the_driver_need_the_option(tmp_path: Path) -> None:
    words = [str(RIDE), "driver.valid_ms:=50", "--output", str(tmp_path / "run")]
    with NodeProcess(words) as ride:
        assert ride.wait() == 2
        assert "belong to --hardware-in-the-loop" in ride.output
