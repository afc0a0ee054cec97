"""The controller as a process: goals, policies, what it refuses and survives."""

from __future__ import annotations

import math
import re
import signal
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from bicycle_msgs.msg import BicycleState, EpisodeInfo, GoalStatus
from bicycle_msgs.srv import LoadPolicy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Path as PathMessage
from node_process import NodeProcess, parameters
from probe import Probe, goal
from visualization_msgs.msg import Marker

from bicycle_common.nodes import convert, topics
from bicycle_common.nodes.topics import (
    COMMAND,
    COMMAND_ECHO,
    GOAL_PATH,
    GOAL_POSE,
    GOAL_STATUS,
    STATE,
)
from bicycle_common.types import InitialPose
from bicycle_controller.policy.trained_for import UNLIKE
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named

pytestmark = [
    pytest.mark.ros,
    pytest.mark.slow,
    pytest.mark.usefixtures("no_new_shared_memory"),
]

SIM = "bicycle_sim.nodes.sim_node"
CONTROLLER = "bicycle_controller.nodes.controller_node"
SCENARIO = named("random-start-random-goal")
StartNode = Callable[..., NodeProcess]


@pytest.fixture
def start_controller(start_node: StartNode) -> Callable[..., NodeProcess]:
    def start(policy: str = "lqr", **values: object) -> NodeProcess:
        process = start_node(CONTROLLER, parameters(policy=policy, **values))
        process.wait_for_line("waits for a goal")
        return process

    return start


@pytest.fixture
def probe(ros_domain: int) -> Iterator[Probe]:
    goals = GOAL_STATUS, topics.ACTIVE_GOAL, topics.GOAL_MARKER
    probe = Probe(ros_domain, COMMAND_ECHO, STATE, COMMAND, *goals)
    yield probe
    probe.close()


def senders(probe: Probe) -> set[str]:
    """Names of the controllers whose commands were applied."""
    return {echo.command.controller for echo in probe[COMMAND_ECHO]} - {""}


def path(*points: tuple[float, float]) -> PathMessage:
    message = PathMessage(poses=[goal(x, y, "") for x, y in points])
    message.header.frame_id = "odom"
    return message


def statuses(probe: Probe) -> list[tuple[int, int]]:
    return [(one.goal_id, one.status) for one in probe[GOAL_STATUS]]


def first_statuses(probe: Probe, count: int) -> list[GoalStatus]:
    """Return the first `count` goal statuses, once they are there."""
    probe.spin_until(lambda: len(probe[GOAL_STATUS]) >= count)
    return list(probe[GOAL_STATUS])


class FakeSim:
    """The real physics, published by the test itself: one step for each answer."""

    def __init__(self, probe: Probe) -> None:
        self.probe = probe
        self.simulator = Simulator(SCENARIO)
        self.simulator.reset(InitialPose(0.0, 0.0, 0.0, SCENARIO.start_speed))
        info = EpisodeInfo(
            episode=1, scenario=SCENARIO.to_json(), physics=ChoiPlant().to_json(), version="test"
        )
        probe.say(topics.EPISODE, info)

    def message(self) -> BicycleState:
        snapshot = self.simulator.snapshot
        return convert.from_snapshot(snapshot, snapshot.step * 25_000_000)

    def publish(self) -> None:
        self.probe.say(STATE, self.message())

    def step(self) -> Any:
        """Publish the state until it is answered, as the simulator does, and obey."""
        state = self.simulator.snapshot
        commands = self.probe[COMMAND]

        def unanswered() -> bool:
            newest = commands[-1] if commands else None
            return newest is None or (newest.episode, newest.step) != (state.episode, state.step)

        while unanswered():
            self.publish()
            self.probe.spin_while(unanswered, 0.1)
        self.simulator.step(convert.to_command(commands[-1]))
        return commands[-1]

    def ride_to(self, goal_id: int) -> Any:
        """Step until the controller has taken a goal; the first command on the way to it."""
        return self.probe.spin_until(
            lambda: (command := self.step()).goal_id == goal_id and command
        )


# Goals.


def test_it_rides_waypoints_in_order(start_sim: Any, start_controller: Any, probe: Probe) -> None:
    start_sim(pace="lockstep")
    controller = start_controller()
    probe.say(GOAL_PATH, path((8.0, 3.0), (14.0, 0.0)))
    probe.spin_until(lambda: (2, GoalStatus.REACHED) in statuses(probe))
    assert statuses(probe) == [
        (2, GoalStatus.QUEUED),
        (1, GoalStatus.ACTIVE),
        (1, GoalStatus.REACHED),
        (2, GoalStatus.ACTIVE),
        (2, GoalStatus.REACHED),
    ]
    reached = probe[GOAL_STATUS][2]
    assert reached.distance <= 1.0
    assert 7.0 < reached.path_length < 10.0
    assert reached.elapsed == pytest.approx(reached.path_length / SCENARIO.start_speed, rel=0.03)
    shown = [(g.pose.position.x, g.pose.position.y) for g in probe[topics.ACTIVE_GOAL]]
    assert shown == [(8.0, 3.0), (14.0, 0.0)]
    markers = probe[topics.GOAL_MARKER]
    probe.spin_until(lambda: markers[-1].action == Marker.DELETE)
    drawn = [(m.pose.position.x, m.scale.x) for m in markers if m.action == Marker.ADD]
    assert list(dict.fromkeys(drawn)) == [(8.0, 2.0), (14.0, 2.0)]
    probe.spin_until(lambda: not probe[COMMAND][-1].has_goal)
    begun = probe[STATE][-1].step
    probe.spin_until(lambda: probe[STATE][-1].step > begun + 200)
    assert not probe[STATE][-1].fallen, "it rides straight on after the last goal"
    assert controller.running


def test_a_new_goal_replaces_the_old_and_one_in_the_map_will_do(
    start_controller: Any, probe: Probe
) -> None:
    start_controller()
    sim = FakeSim(probe)
    probe.say(GOAL_POSE, goal(100.0, 0.0))
    first = sim.step()
    probe.say(GOAL_POSE, goal(0.0, 100.0, "map"))
    second = sim.ride_to(2)
    assert (first.goal.x, first.goal_id, second.goal.y, second.goal_id) == (100.0, 1, 100.0, 2)
    probe.spin_until(lambda: len(statuses(probe)) == 3)
    assert statuses(probe)[1:] == [(1, GoalStatus.REPLACED), (2, GoalStatus.ACTIVE)]


def test_bad_goals_are_rejected_with_a_reason(start_controller: Any, probe: Probe) -> None:
    controller = start_controller()
    sim = FakeSim(probe)
    mixed = path((1.0, 1.0))
    mixed.poses.append(goal(math.inf, 0.0))
    bad = {
        "frame is 'base_link': send it in 'odom' or 'map'": (GOAL_POSE, goal(1, 1, "base_link")),
        "frame is ''": (GOAL_POSE, goal(1, 1, "")),
        r"\(nan, 0.0\) is not finite": (GOAL_POSE, goal(math.nan, 0.0)),
        "is beyond 10000 m": (GOAL_POSE, goal(1e5, 0.0)),
        r"\(inf, 0.0\) is not finite": (GOAL_PATH, mixed),
    }
    for count, (words, (topic, message)) in enumerate(bad.items(), start=1):
        probe.say(topic, message)
        controller.wait_for_line(f"goal rejected: .*{words}")
        assert first_statuses(probe, count)[-1].status == GoalStatus.REJECTED
    sim.publish()
    probe.spin_for(0.5)
    assert probe[COMMAND] == [], "a rejected goal is no goal"
    probe.say(GOAL_POSE, goal(5.0, 5.0))
    assert sim.step().goal_id == 1


def test_a_reset_cancels_and_a_fall_ends_the_goal(start_controller: Any, probe: Probe) -> None:
    start_controller()
    sim = FakeSim(probe)
    probe.say(GOAL_POSE, goal(50.0, 0.0))
    sim.step()
    sim.simulator.reset(InitialPose(0.0, 0.0, 0.0, 2.5))
    sim.publish()
    probe.spin_until(lambda: statuses(probe)[-1:] == [(1, GoalStatus.CANCELLED)])
    probe.say(GOAL_POSE, goal(50.0, 0.0))
    sim.ride_to(2)
    down = sim.message()
    down.fallen = True
    probe.say(STATE, down)
    probe.spin_until(lambda: statuses(probe)[-1:] == [(2, GoalStatus.FALLEN)])


def test_the_same_state_again_gets_the_same_command(start_controller: Any, probe: Probe) -> None:
    start_controller(exploration="gaussian", exploration_sigma=0.5)
    sim = FakeSim(probe)
    probe.say(GOAL_POSE, goal(9.0, 9.0))
    first = sim.step()
    step_one = sim.message()
    second = sim.step()
    count = len(probe[COMMAND])
    probe.say(STATE, step_one)
    probe.spin_until(lambda: len(probe[COMMAND]) > count)
    third = probe[COMMAND][-1]
    assert (third.step, third.torque) == (second.step, second.torque)
    assert first.torque != second.torque


def test_a_state_that_is_not_finite_is_not_answered(start_controller: Any, probe: Probe) -> None:
    controller = start_controller()
    sim = FakeSim(probe)
    probe.say(GOAL_POSE, goal(9.0, 9.0))
    sim.step()
    bad = sim.message()
    bad.lean_rate = math.nan
    probe.say(STATE, bad)
    controller.wait_for_line("state not answered: it holds a number that is not finite")
    assert sim.step().step == 1


# Policies.


def test_loading_a_policy_drops_no_step(start_controller: Any, probe: Probe) -> None:
    start_controller()
    sim = FakeSim(probe)
    probe.say(GOAL_POSE, goal(300.0, 900.0))
    before = [sim.step() for _ in range(5)]
    service = topics.LOAD_POLICY
    client = probe.node.create_client(service.type, service.name)
    probe.spin_until(client.service_is_ready)
    future = client.call_async(LoadPolicy.Request(path="lqr-displacement"))
    during = [sim.step()]
    while not future.done():
        during.append(sim.step())
    after = [sim.step() for _ in range(20)]
    answers = before + during + after
    assert [one.step for one in answers] == list(range(len(answers)))
    names = [one.policy for one in answers]
    result = future.result()
    assert result.success
    assert result.policy == names[-1] != names[0]
    changes = [a != b for a, b in pairwise(names)]
    assert sum(changes) == 1
    assert any(abs(one.displacement) > 0 for one in after)


def test_a_policy_that_cannot_be_loaded_changes_nothing(
    start_controller: Any, probe: Probe, tmp_path: Path
) -> None:
    start_controller()
    sim = FakeSim(probe)
    probe.say(GOAL_POSE, goal(0.0, 900.0))
    name = sim.step().policy
    foreign = tmp_path / "foreign.safetensors"
    foreign.write_bytes(b"\x80\x04not a policy")
    for bad, words in (("/nowhere.safetensors", "does not exist"), (str(foreign), "cannot load")):
        result = probe.call(topics.LOAD_POLICY, LoadPolicy.Request(path=bad))
        assert not result.success
        assert words in result.message
        assert f"{name} stays in charge" in result.message
        assert result.policy == name
    assert sim.step().policy == name


def test_a_policy_that_rides_another_bicycle_than_it_was_trained_on_is_warned_of(
    start_sim: Any, start_controller: Any, probe: Probe
) -> None:
    """The warning is in the log, in the service's answer, and in the diagnostics for the page."""
    texts: list[str] = []

    def hear(array: DiagnosticArray) -> None:
        texts.extend(i.value for s in array.status for i in s.values if i.key == UNLIKE)

    probe.node.create_subscription(DiagnosticArray, topics.DIAGNOSTICS.name, hear, 10)
    start_sim(physics="corrected")
    controller = start_controller("fixed-speed", diagnostics_period=0.1)
    words = r"fixed-speed@\w+ was made for another ride .*gyroscopic_correction true, not false"
    controller.wait_for_line(words)
    probe.spin_until(lambda: any(re.search(words, text) for text in texts))
    answer = probe.call(topics.LOAD_POLICY, LoadPolicy.Request(path="naf"))
    assert answer.success
    assert "naf" in answer.message
    assert "was made for another ride" in answer.message


def test_a_policy_on_its_own_bicycle_is_not_warned_of(
    start_sim: Any, start_controller: Any, probe: Probe
) -> None:
    arrays: list[DiagnosticArray] = []
    probe.node.create_subscription(DiagnosticArray, topics.DIAGNOSTICS.name, arrays.append, 10)
    start_sim()
    controller = start_controller("fixed-speed", diagnostics_period=0.1)
    probe.spin_until(
        lambda: sum(i.key == UNLIKE for a in arrays for s in a.status for i in s.values) > 5
    )
    values = {i.value for a in arrays for s in a.status for i in s.values if i.key == UNLIKE}
    assert values == {"no"}
    assert "another ride" not in controller.output


def test_it_rides_without_torch(start_controller: Any) -> None:
    controller = start_controller()
    assert "libtorch" not in Path(f"/proc/{controller.pid}/maps").read_text()


# Mistakes and ends.


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"policy": "/nowhere.safetensors"}, "does not exist"),
        ({"policy": "lqrr"}, "lqrr"),
        ({"polcy": "lqr"}, "did you mean 'policy'"),
        ({"policy": "lqr", "exploration_sigma": "-1.0"}, "choose 0 to 10"),
        ({"policy": "lqr", "exploration": "loud"}, "choose one of none, ou, gaussian"),
    ],
)
def test_a_users_mistake_is_one_line_and_status_2(
    start_node: StartNode, values: dict[str, str], words: str
) -> None:
    controller = start_node(CONTROLLER, parameters(**values))
    assert controller.wait() == 2, controller.output
    own = [line for line in controller.lines if line.startswith("bicycle_controller: ")]
    assert len(own) == 1, controller.output
    assert words in own[0]
    assert "Traceback" not in controller.output


def test_killed_and_started_again_it_rides_on_to_the_goal(
    start_sim: Any, start_controller: Any, probe: Probe
) -> None:
    # Slowly, so that on a busy machine the bicycle is not held, or even falls, while it is ridden.
    sim = start_sim(on_timeout="pause", real_time_factor=0.25)
    first = start_controller()
    probe.say(GOAL_POSE, goal(9.0, 1.0))
    probe.spin_until(lambda: probe[STATE] and probe[STATE][-1].step > 30)
    first.kill()
    sim.wait_for_line("no valid command for 0.25 s.*held")
    second = start_controller()
    probe.spin_until(lambda: statuses(probe)[-1:] == [(1, GoalStatus.REACHED)])
    assert second.running
    riders = senders(probe)
    assert len(riders) == 2
    assert not probe[STATE][-1].fallen


def test_a_simulator_killed_and_started_again_is_ridden_to_the_goal(
    start_sim: Any, start_controller: Any, probe: Probe
) -> None:
    first = start_sim(pace="lockstep")
    start_controller()
    probe.say(GOAL_POSE, goal(1e4, 0.0))
    probe.spin_until(lambda: probe[STATE] and probe[STATE][-1].step > 30)
    first.kill()
    start_sim(pace="lockstep", start_x=9990.0)
    probe.spin_until(lambda: statuses(probe) == [(1, GoalStatus.ACTIVE), (1, GoalStatus.REACHED)])


def test_of_two_controllers_one_rides(start_sim: Any, start_controller: Any, probe: Probe) -> None:
    start_sim(pace="lockstep")
    both = [start_controller(), start_controller()]
    probe.say(GOAL_POSE, goal(9.0, 1.0))
    probe.spin_until(lambda: (1, GoalStatus.REACHED) in statuses(probe))
    idle = "drives this bicycle, so this controller sends nothing: stop one of the two"
    probe.spin_until(lambda: sum(idle in one.output for one in both) == 1)
    probe.spin_for(0.5)
    assert statuses(probe).count((1, GoalStatus.REACHED)) == 1, "who does not ride reaches nothing"
    # The state's last messages may be under way still when the status has come.
    probe.spin_until(lambda: senders(probe))
    assert len(senders(probe)) == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_cleanly(
    start_controller: Any, probe: Probe, number: signal.Signals
) -> None:
    controller = start_controller()
    sim = FakeSim(probe)
    probe.say(GOAL_POSE, goal(9.0, 1.0))
    sim.step()
    assert controller.stop(number) == 0, controller.output
    assert "Traceback" not in controller.output
