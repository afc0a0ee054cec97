"""Whatever is killed, in whatever order, at whatever moment: it rides again."""

from __future__ import annotations

import ast
import struct
import subprocess
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path

import pytest
from chaos import Chaos
from node_process import NodeProcess
from probe import Probe, goal
from rclpy.serialization import deserialize_message
from soak import Soak
from soak_figures import bag_figures
from std_msgs.msg import String

from bicycle_bag.reader import BagReader
from bicycle_common.nodes.topics import COMMAND, COMMAND_ECHO, GOAL_POSE, STATE, TIMING, Topic

pytestmark = [pytest.mark.ros, pytest.mark.slow]

ROOT = Path(__file__).parents[2]
SOURCES = [
    *(ROOT / "bicycle_sim").rglob("bicycle_sim/**/*.py"),
    *(ROOT / "bicycle_controller").rglob("bicycle_controller/**/*.py"),
    *(ROOT / "ros2_ws" / "src").glob("*/bicycle_*/**/*.py"),
]
STRIKES = 4
"""Strikes at least; they go on until everything has been killed once."""
MOST_STRIKES = 20


@pytest.mark.parametrize("seed", [1])
def test_after_each_strike_it_rides_again(ros_domain: int, tmp_path: Path, seed: int) -> None:
    """The long form is `tests/tools/chaos.py`; its figures are in docs/reliability.md."""
    chaos = Chaos(ros_domain, tmp_path, seed)
    everything = {"simulator", "controller", "recorder"}
    killed: set[str] = set()
    strikes = 0
    try:
        while strikes < STRIKES or (killed != everything and strikes < MOST_STRIKES):
            killed |= set(chaos.strike()["killed"])
            strikes += 1
    finally:
        chaos.close()
    assert killed == everything
    assert chaos.orphans == []


def test_a_long_ride_loses_no_step_and_keeps_nothing(ros_domain: int, tmp_path: Path) -> None:
    """The long form is `tests/tools/soak.py`; its figures are in docs/reliability.md."""
    steps = 2400
    soak = Soak(ros_domain, tmp_path, "lockstep")
    try:
        samples = soak.ride(steps)
        statuses = soak.close()
    finally:
        soak.kill()
    assert set(statuses) == {"simulator", "controller", "recorder", "cockpit", "page"}
    assert set(statuses.values()) == {0}
    found = bag_figures(soak.bag, 10_000)
    assert found["steps"] >= steps
    assert found["states_missing"] == 0
    assert found["messages_lost_by_the_recorders_count"] == "0"
    assert found["verified"] == f"{found['steps']} states came out again, bit for bit"
    assert len(samples) > 3
    third = len(samples) // 3  # a quick machine has few
    settled, late = samples[len(samples) // 4 : -third], samples[-third:]
    for name in statuses:
        for what in ("files", "threads"):  # at times one is open for a moment
            least, most = (
                pick(sample[name][what] for sample in some)
                for pick, some in ((min, late), (max, settled))
            )
            assert least <= most, f"{what} of {name}"


# Clocks.

LATE = Topic("late", String, GOAL_POSE.publish, GOAL_POSE.subscribe)


def calls(name: str) -> Iterator[tuple[Path, ast.Call]]:
    """Every call of a function or method of that name."""
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text())):
            match node:
                case ast.Call(func=ast.Attribute(attr=attr)) if attr == name:
                    yield path, node


def rides_on(probe: Probe, step: int) -> bool:
    """Return True if the bicycle has passed that step."""
    return bool(probe[STATE][-1].step > step)


def test_every_timer_takes_the_steady_clock() -> None:
    timers = list(calls("create_timer"))
    assert len(timers) >= 10
    wrong = [
        f"{path.relative_to(ROOT)}:{call.lineno}"
        for path, call in timers
        if not any(
            word.arg == "clock" and "steady" in ast.unparse(word.value).lower()
            for word in call.keywords
        )
    ]
    assert wrong == []


def test_jumps_of_the_systems_clock_do_not_matter(
    ros_domain: int, tmp_path: Path, start_node: Callable[..., NodeProcess]
) -> None:
    """An hour forward and two days back while it rides: no step is dropped, none without command.

    The middleware is jumped with the nodes, for the library stands between them and the clock. A
    recorder rides along; a topic that comes up after the jumps is recorded too.
    """
    moved, library = tmp_path / "moved", tmp_path / "clock_jump.so"
    moved.write_bytes(struct.pack("q", 0))
    source = str(Path(__file__).parents[1] / "support" / "clock_jump.c")
    build = ["g++", "-x", "c", "-shared", "-fPIC", "-Wall", "-Werror", source, "-o", str(library)]
    subprocess.run(build, check=True)
    env = {"LD_PRELOAD": str(library), "CLOCK_JUMP": str(moved)}
    probe = Probe(ros_domain, COMMAND_ECHO, STATE, COMMAND, TIMING)
    try:
        # Slowly, so that no command is late for eight seconds because the machine is busy.
        slow = ["--ros-args", "-p", "real_time_factor:=0.25", "-p", "watchdog_timeout:=2.0"]
        sim = start_node("bicycle_sim.nodes.sim_node", slow, env)
        sim.wait_for_line("episode 1 waits")
        words = ["--ros-args", "-p", "policy:=lqr"]
        start_node("bicycle_controller.nodes.controller_node", words, env)
        probe.publisher(GOAL_POSE)
        bag = ["--all", "--output", str(tmp_path / "bag")]
        recorder = start_node("bicycle_bag.nodes.recorder_node", bag, env)
        recorder.wait_for_line("recording")
        probe.say(GOAL_POSE, goal(9000.0, 0.0))
        probe.spin_until(lambda: probe[STATE] and probe[STATE][-1].step > 60)
        stamps = [probe[COMMAND][-1].header.stamp.sec]
        for jump in (3_600, -2 * 86_400, 0):
            begun = probe[STATE][-1].step
            with moved.open("r+b") as file:
                file.write(struct.pack("q", jump))
            probe.spin_until(partial(rides_on, probe, begun + 30))
            stamps.append(probe[COMMAND][-1].header.stamp.sec)
            if jump < 0:
                probe.say(LATE, String(data="after the jump"), recorder=True)
        last = probe[STATE][-1].step
        assert recorder.stop() == 0
    finally:
        probe.close()
    jumps = [after - before for before, after in pairwise(stamps)]
    assert jumps[0] > 3500, "the clock was not moved"
    assert jumps[1] < -170_000
    assert not probe[STATE][-1].fallen
    assert {echo.command_source for echo in probe[COMMAND_ECHO] if echo.step > 40} <= {1, 2}
    assert "no valid command" not in sim.output
    reader = BagReader(tmp_path / "bag")
    assert len(list(reader.messages([f"/{LATE.name}"]))) == 1
    states = [
        deserialize_message(message.data, STATE.type)
        for message in reader.messages([f"/{STATE.name}"])
    ]
    # About a jump back the bag's order, which is that of time, is not that of the steps.
    steps = sorted({state.step for state in states})
    assert steps[0] < 60
    assert steps[-1] >= last
    assert steps == list(range(steps[0], steps[-1] + 1))
    # A jump that counted as waiting would have dropped an hour of periods.
    assert probe[TIMING][-1].dropped_steps < 100_000
