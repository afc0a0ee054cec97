"""The simulator as a process: what it publishes, obeys, refuses and survives."""

from __future__ import annotations

import math
import signal
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from bicycle_msgs.msg import BicycleCommand, BicycleState, CommandEcho
from bicycle_msgs.srv import Push, Reset
from geometry_msgs.msg import PoseWithCovarianceStamped
from node_process import NodeProcess, parameters
from probe import Probe, command
from std_srvs.srv import SetBool, Trigger

from bicycle_common.nodes import convert, topics
from bicycle_common.nodes.topics import COMMAND, COMMAND_ECHO, STATE, TIMING
from bicycle_sim.nodes.episode_setting import to_setting
from bicycle_sim.plants.choi.plant import ChoiPlant

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("no_new_shared_memory")]

SIM = "bicycle_sim.nodes.sim_node"
StartNode = Callable[..., NodeProcess]


@pytest.fixture
def probe(ros_domain: int) -> Iterator[Probe]:
    probe = Probe(ros_domain, COMMAND_ECHO, STATE, TIMING, topics.DIAGNOSTICS)
    yield probe
    probe.close()


def newest(probe: Probe) -> BicycleState:
    return probe.spin_until(lambda: probe[STATE] and probe[STATE][-1])


def at_step(probe: Probe, step: int) -> BicycleState:
    return probe.spin_until(lambda: next((s for s in probe[STATE] if s.step == step), None))


def echo_of(probe: Probe, state: BicycleState) -> CommandEcho:
    """The echo of the command that led to a state."""
    key = state.episode, state.step

    def found() -> CommandEcho | None:
        echoes = (echo for echo in probe[COMMAND_ECHO] if (echo.episode, echo.step) == key)
        return next(echoes, None)

    echo: CommandEcho = probe.spin_until(found)
    return echo


def answer_upright(state: BicycleState) -> BicycleCommand:
    return command(state, has_goal=True, goal=convert.to_point((900.0, 0.0)), goal_id=1)


# What it does.


def test_it_publishes_all_that_others_expect(start_sim: Any, ros_domain: int) -> None:
    start_sim(pace="lockstep", start_x=3.0, start_yaw=0.5)
    probe = Probe(
        ros_domain,
        COMMAND_ECHO,
        STATE,
        topics.ODOMETRY,
        topics.JOINT_STATES,
        topics.CLOCK,
        topics.MARKERS,
        topics.DIAGNOSTICS,
        topics.EPISODE,
        TIMING,
    )
    first = newest(probe)
    assert first.heading == pytest.approx(0.5)
    assert (first.rear_contact.x, first.step, first.episode) == (3.0, 0, 1)
    probe.spin_until(lambda: probe[topics.ODOMETRY])
    assert first.speed > 0.0
    assert probe[topics.ODOMETRY][0].twist.twist.linear.x == 0.0  # it waits at its start
    probe.say(COMMAND, command(first, torque=0.5))
    state = at_step(probe, 1)
    assert state.steer_angle > 0
    echo = echo_of(probe, state)
    assert echo.command_source == CommandEcho.SOURCE_FRESH
    assert (echo.command.step, echo.command.controller) == (0, "probe")
    assert echo.command.torque == 0.5
    assert echo_of(probe, first).command_source == CommandEcho.SOURCE_INITIAL
    probe.spin_until(lambda: all(probe.heard[t.name] for t in (TIMING, topics.DIAGNOSTICS)))
    odometry = probe[topics.ODOMETRY][-1]
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
    assert convert.to_yaw(odometry.pose.pose.orientation) == pytest.approx(state.heading, abs=1e-3)
    assert odometry.twist.twist.linear.x == state.speed
    joints = probe[topics.JOINT_STATES][-1]
    assert list(joints.name) == ["steer", "front_wheel", "rear_wheel", "crank"]
    assert joints.position[0] == state.steer_angle
    assert joints.position[1] == pytest.approx(state.speed * 0.025 / 0.34)
    clock = probe[topics.CLOCK][-1].clock
    assert (clock.sec, clock.nanosec) == (0, 25_000_000)
    assert {m.ns for m in probe[topics.MARKERS][-1].markers} >= {
        "front wheel",
        "rider",
    }
    names = {status.name for status in probe[topics.DIAGNOSTICS][-1].status}
    assert names == {f"bicycle_sim: {what}" for what in ("loop", "commands", "bicycle")}
    (episode,) = probe[topics.EPISODE]
    scenario, plant = to_setting(episode)
    assert scenario.name == "random-start-random-goal"
    assert plant == ChoiPlant()
    probe.close()


def test_the_schedule_accounts_for_every_period(start_sim: Any, probe: Probe) -> None:
    start_sim(real_time_factor=4)
    probe.on_state = answer_upright
    probe.spin_until(lambda: len(probe[TIMING]) > 150)
    timings = probe[TIMING]
    assert [one.step for one in timings] == list(range(1, len(timings) + 1)), "no step is lost"
    first, last = timings[0], timings[-1]
    elapsed = sum(one.period for one in timings[1:])
    # What is dropped at a step lengthens the period after it: the last one's is still to come.
    periods = len(timings) - 1 + timings[-2].dropped_steps
    assert elapsed == pytest.approx(periods * 0.00625 + last.lateness - first.lateness, abs=1e-6)


def test_a_push_acts_once_and_is_told(start_sim: Any, ros_domain: int) -> None:
    start_sim(pace="lockstep")
    probe = Probe(ros_domain, STATE, topics.PUSHED)
    first = newest(probe)
    for wrong in (math.nan, 5.0):
        answer = probe.call(topics.PUSH, Push.Request(lean_rate=wrong))
        assert not answer.success
        assert answer.message.startswith("not pushed: ")
    assert probe.call(topics.PUSH, Push.Request(lean_rate=0.25)).success
    probe.say(COMMAND, command(first))
    (pushed,) = probe.spin_until(lambda: probe[topics.PUSHED])
    assert (pushed.episode, pushed.step, pushed.lean_rate) == (1, 0, 0.25)
    state = at_step(probe, 1)
    assert state.lean_rate == 0.25
    probe.close()


def random_ride(start_node: StartNode, domain: int, steps: int) -> list[str]:
    """States of a lock-step ride under seeded random commands; repr shows every bit."""
    sim = start_node(
        SIM,
        parameters(
            pace="lockstep",
            random_start=True,
            seed=9,
            displacement_noise=0.01,
            physics="corrected",
        ),
    )
    sim.wait_for_line("episode 1 waits")
    rng = np.random.default_rng(3)
    actions = rng.uniform(-0.3, 0.3, size=(steps, 2))
    probe = Probe(domain, STATE)

    def answer(state: BicycleState) -> BicycleCommand | None:
        if state.step >= steps or state.fallen:
            return None
        torque, displacement = (float(value) for value in actions[state.step])
        return command(state, torque=torque, displacement=0.1 * displacement)

    probe.on_state = answer
    probe.spin_until(
        lambda: probe[STATE] and (probe[STATE][-1].fallen or probe[STATE][-1].step >= steps)
    )
    by_step = {state.step: repr(state) for state in probe[STATE]}
    probe.close()
    assert sim.stop(signal.SIGTERM) == 0
    return [by_step[step] for step in sorted(by_step)]


def test_lockstep_gives_the_same_bits_twice(start_node: StartNode, ros_domain: int) -> None:
    first = random_ride(start_node, ros_domain, 120)
    assert len(first) > 40
    for one, again in zip(first, random_ride(start_node, ros_domain, 120), strict=True):
        assert one == again


# What it refuses.


def test_bad_commands_are_told_and_change_nothing(start_sim: Any, probe: Probe) -> None:
    sim = start_sim(pace="lockstep", watchdog_timeout=3600)
    first = newest(probe)
    bad: dict[str, dict[str, Any]] = {
        "torque is nan": {"torque": math.nan},
        "beyond the scenario's 0.2 m": {"displacement": -0.3},
        "this is episode 1": {"episode": 7},
        "at step 0 only": {"step": 3},
    }
    for words, changes in bad.items():
        probe.say(COMMAND, command(first, **changes))
        sim.wait_for_line(words)
    probe.spin_for(0.3)
    assert {state.step for state in probe[STATE]} == {0}
    probe.say(COMMAND, command(first))
    second = at_step(probe, 1)
    probe.say(COMMAND, command(second))
    third = at_step(probe, 2)
    probe.say(COMMAND, command(third, step=0))
    sim.wait_for_line("step 1 is answered already")
    probe.say(COMMAND, command(third, controller="intruder"))
    sim.wait_for_line("'intruder' ignored: 'probe' is in charge: stop one of the two")
    probe.spin_for(0.3)
    assert newest(probe).step == 2


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--ros-args", "-p", "real_time_facto:=2"], "did you mean 'real_time_factor'"),
        (["--ros-args", "-p", "real_time_factor:=-1.0"], "choose 0.01 to 100"),
        (["--ros-args", "-p", "real_time_factor:=.nan"], "choose 0.01 to 100"),
        (["--ros-args", "-p", "real_time_factor:=fast"], "must be a float"),
        (["--ros-args", "-p", "pace:=quick"], "choose one of realtime, lockstep"),
        (["--ros-args", "-p", "scenario:=mars"], "choose one of fixed-start"),
        (["--ros-args", "-p", "seed:=-4"], "parameter seed is -4"),
        (["--ros-args", "-p", "seed"], "cannot"),
        (["--ros-args", "-p", "start_speed:=30"], "choose -1 to 20"),
        (
            ["--ros-args", "-p", "scenario:=learned-speed", "-p", "start_speed:=6.0"],
            "outside the scenario's limits 1 to 5 m/s: choose another start_speed",
        ),
        (["--ros-args", "-p", "watchdog_timeout:=0.01"], "0 for never, or 0.1 s or more"),
        (["--ros-args", "--params-file", "/nowhere.yaml"], "/nowhere.yaml"),
        (["--pace", "lockstep"], "unknown argument '--pace'"),
    ],
)
def test_a_users_mistake_is_one_line_and_status_2(
    start_node: StartNode, arguments: list[str], words: str
) -> None:
    sim = start_node(SIM, arguments)
    assert sim.wait() == 2, sim.output
    own = [line for line in sim.lines if line.startswith("bicycle_sim: ")]
    assert len(own) == 1, sim.output
    assert words in own[0]
    assert "Traceback" not in sim.output


def test_help_lists_every_parameter(start_node: StartNode) -> None:
    sim = start_node(SIM, ["--help"])
    assert sim.wait() == 0
    assert "watchdog_timeout:=0.25" in sim.output


def test_a_busy_domain_is_refused_and_another_namespace_is_not(
    start_sim: Any, start_node: StartNode, ros_domain: int
) -> None:
    start_sim()
    second = start_node(SIM)
    assert second.wait() == 2
    assert f"ROS_DOMAIN_ID={ros_domain}" in second.output
    assert "stop.sh" in second.output
    third = start_node(SIM, ["--ros-args", "-r", "__ns:=/other"])
    third.wait_for_line("episode 1 waits")


def test_after_a_killed_simulator_the_next_one_starts(start_sim: Any) -> None:
    start_sim().kill()
    start_sim()


# Watchdog, pause, reset.

SLOW = 2.0
"""s without a command; a busy machine may hold up the test's own answers for shorter ones."""


def ride_some(probe: Probe, steps: int) -> None:
    probe.on_state = answer_upright
    probe.spin_until(lambda: probe[STATE] and probe[STATE][-1].step >= steps)
    probe.on_state = None


def sources(probe: Probe) -> list[int]:
    by_step = {echo.step: echo.command_source for echo in probe[COMMAND_ECHO]}
    return [by_step[step] for step in sorted(by_step)]


def test_without_commands_zero_input_is_applied_and_told(start_sim: Any, probe: Probe) -> None:
    sim = start_sim(watchdog_timeout=SLOW)
    ride_some(probe, 10)
    sim.wait_for_line("no valid command for 2 s.*zero input until the next one")
    probe.spin_until(lambda: set(sources(probe)[-20:]) == {CommandEcho.SOURCE_ZERO})
    reports = probe[topics.DIAGNOSTICS]
    probe.spin_until(
        lambda: reports and any("zero input" in status.message for status in reports[-1].status)
    )
    heard = len(sources(probe))
    ride_some(probe, newest(probe).step + 10)
    sim.wait_for_line("commands again")
    probe.spin_until(lambda: CommandEcho.SOURCE_FRESH in sources(probe)[heard:])
    assert sum("no valid command" in line for line in sim.lines) == 1, "told once"


def test_by_parameter_the_bicycle_is_held_instead(start_sim: Any, probe: Probe) -> None:
    sim = start_sim(on_timeout="pause", watchdog_timeout=SLOW)
    ride_some(probe, 10)
    sim.wait_for_line("no valid command for 2 s.*held until the next one")
    line = sim.wait_for_line(r"no valid command for 2 s at step (\d+)")
    held = int(line.group(1))
    at_step(probe, held)
    probe.spin_for(0.5)
    assert newest(probe).step == held
    ride_some(probe, held + 10)
    assert CommandEcho.SOURCE_ZERO not in sources(probe)


def test_pause_single_step_and_go_on(start_sim: Any, probe: Probe) -> None:
    start_sim(pace="lockstep")
    refused = probe.call(topics.STEP, Trigger.Request())
    assert not refused.success
    assert "call bicycle/pause" in refused.message
    assert probe.call(topics.PAUSE, SetBool.Request(data=True)).success
    probe.on_state = answer_upright
    probe.spin_for(0.4)
    assert newest(probe).step == 0
    for step in (1, 2):
        assert probe.call(topics.STEP, Trigger.Request()).success
        echo = echo_of(probe, at_step(probe, step))
        assert echo.command_source == CommandEcho.SOURCE_FRESH
        probe.spin_for(0.2)
    assert newest(probe).step == 2
    assert probe.call(topics.PAUSE, SetBool.Request(data=False)).success
    at_step(probe, 30)


def reset(probe: Probe, x: float = 0.0, z: float = 0.0, w: float = 1.0, **values: Any) -> Any:
    request = Reset.Request(**{"speed": -1.0, "seed": -1, **values})
    request.pose.position.x = x
    request.pose.orientation.z, request.pose.orientation.w = z, w
    return probe.call(topics.RESET, request)


def test_reset_puts_the_bicycle_where_it_is_told(start_sim: Any, probe: Probe) -> None:
    start_sim(pace="lockstep", seed=5)
    done = reset(probe, x=4.0, z=1.0, w=0.0, speed=1.5)
    assert (done.success, done.episode) == (True, 2)
    state = probe.spin_until(lambda: newest(probe).episode == 2 and newest(probe))
    assert (state.rear_contact.x, state.speed) == (4.0, 1.5)
    assert abs(state.heading) == pytest.approx(math.pi)
    for words, bad in {
        "length 1": {"w": 0.5},
        "must be finite": {"x": math.nan},
        "speed must be": {"speed": 1e9},
    }.items():
        refused = reset(probe, **bad)
        assert not refused.success
        assert words in refused.message
        assert refused.episode == 2
    starts = []
    for seed in (77, 77, 78):
        assert reset(probe, random_start=True, seed=seed).success
        episode = newest(probe).episode + 1
        starts.append(newest(probe).rear_contact)
        assert newest(probe).episode == episode - 1
    assert starts[0] == starts[1] != starts[2]


def test_an_initial_pose_is_a_reset_and_a_bad_one_is_not(start_sim: Any, probe: Probe) -> None:
    sim = start_sim()
    pose = PoseWithCovarianceStamped()
    pose.header.frame_id = "map"
    pose.pose.pose.position.x = -2.0
    probe.say(topics.INITIAL_POSE, pose)
    state = probe.spin_until(lambda: probe[STATE] and newest(probe).episode == 2 and newest(probe))
    assert state.rear_contact.x == -2.0
    pose.header.frame_id = "moon"
    probe.say(topics.INITIAL_POSE, pose)
    sim.wait_for_line("initial pose ignored: its frame is 'moon': send it in 'odom' or 'map'")
    pose.header.frame_id = "odom"
    pose.pose.pose.orientation.w = math.nan
    probe.say(topics.INITIAL_POSE, pose)
    sim.wait_for_line("initial pose ignored: the orientation")


def test_it_falls_stays_down_and_is_reset_by_itself(start_sim: Any, probe: Probe) -> None:
    sim = start_sim(pace="lockstep", reset_after_fall=0.5)
    probe.on_state = lambda state: command(state, torque=2.0) if state.episode == 1 else None
    fallen = probe.spin_until(lambda: next((s for s in probe[STATE] if s.fallen), None))
    assert abs(fallen.lean_angle) > math.pi / 6
    sim.wait_for_line("fell at step")
    sim.wait_for_line("episode 2 waits")
    probe.spin_until(lambda: newest(probe).episode == 2)
    assert max(s.step for s in probe[STATE] if s.episode == 1) == fallen.step


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_cleanly_with_the_last_state_told(
    start_sim: Any, probe: Probe, number: signal.Signals
) -> None:
    sim = start_sim(pace="lockstep")
    probe.on_state = lambda state: answer_upright(state) if state.step < 5 else None
    at_step(probe, 5)
    assert sim.stop(number) == 0, sim.output
    assert [echo_of(probe, at_step(probe, step)).command_source for step in range(6)] == [
        CommandEcho.SOURCE_INITIAL,
        *[CommandEcho.SOURCE_FRESH] * 5,
    ]
    assert "Traceback" not in sim.output
