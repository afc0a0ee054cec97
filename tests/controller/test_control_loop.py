"""One command for every state, whatever the policy does."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bicycle_common.geometry import heading_error
from bicycle_common.types import AppliedCommand, Command, CommandSource, InitialPose
from bicycle_controller.control import control_loop as driving
from bicycle_controller.control.control_loop import ControlLoop
from bicycle_controller.control.exploration_noise import Noise, NoiseConfig
from bicycle_controller.control.goals import GoalTracker, Status
from bicycle_controller.control.lqr import LqrController, fitting
from bicycle_controller.control.safety import Safety
from bicycle_controller.policy.policy import load_policy
from bicycle_sim.plants.whipple import catalogue
from bicycle_sim.plants.whipple.parameters import Motor
from bicycle_sim.plants.whipple.plant import WhipplePlant
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named

SCENARIO = named("random-start-random-goal")
LIMITS = SCENARIO.action_limits
GOAL = (0.0, 40.0)


class Fixed:
    """A policy that does what the test says."""

    policy_id = "fixed"

    def __init__(self, act: Callable[[np.ndarray], np.ndarray]) -> None:
        self._act = act
        self.seen: list[np.ndarray] = []

    def act(self, observation: np.ndarray, speed: np.ndarray) -> np.ndarray:
        assert speed.shape == (1,)
        self.seen.append(observation.copy())
        return self._act(observation)


def constant(*action: float) -> Fixed:
    return Fixed(lambda _: np.array([action]))


@pytest.fixture
def simulator() -> Simulator:
    simulator = Simulator(SCENARIO)
    simulator.reset(InitialPose(0.0, 0.0, 0.4, 2.5))
    return simulator


def driver(policy: object, **options: object) -> ControlLoop:
    return ControlLoop("me", policy, GoalTracker(), LIMITS, **options)  # type: ignore[arg-type]


def ride(rider: ControlLoop, simulator: Simulator, steps: int) -> list[Command | None]:
    commands = []
    for _ in range(steps):
        state = simulator.snapshot
        commands.append(rider.answer(state, 0.025 * state.step, simulator.applied).command)
        simulator.step(commands[-1])
    return commands


def test_nothing_is_answered_before_the_first_goal(simulator: Simulator) -> None:
    rider = driver(constant(1.0, 0.1, 0.0))
    assert rider.answer(simulator.snapshot, 0.0).command is None
    rider.tracker.replace([GOAL])
    command = rider.answer(simulator.snapshot, 0.0).command
    assert command is not None
    assert (command.goal, command.goal_id, command.controller) == (GOAL, 1, "me")
    assert (command.action, command.policy) == ((1.0, 0.1, 0.0), "fixed")


def test_the_same_state_gets_the_same_command_and_no_new_decision(simulator: Simulator) -> None:
    policy = constant(1.0, 0.1, 0.0)
    rider = driver(policy)
    rider.tracker.replace([GOAL])
    first = rider.answer(simulator.snapshot, 0.0).command
    assert rider.answer(simulator.snapshot, 0.0).command is first
    assert len(policy.seen) == 1


def test_the_policy_s_time_is_part_of_the_answer_s(simulator: Simulator) -> None:
    rider = driver(constant(1.0, 0.1, 0.0))
    rider.tracker.replace([GOAL])
    ride(rider, simulator, 3)
    assert len(rider.policy_times) == len(rider.times) == 3
    pairs = zip(rider.policy_times, rider.times, strict=True)
    assert all(0.0 < asked < whole for asked, whole in pairs)


def test_a_slow_policy_is_not_warmed_up(
    simulator: Simulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driving, "QUICK", 0.0)
    policy = constant(1.0, 0.1, 0.0)
    rider = driver(policy)
    rider.tracker.replace([GOAL])
    ride(rider, simulator, 1)
    rider.warm_up()
    assert len(policy.seen) == 1


def test_a_warm_up_asks_the_same_again_and_changes_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(driving, "QUICK", math.inf)
    shipped, commands = load_policy(), []
    for warms_up in (False, True):
        policy = Fixed(shipped.act)
        noise = Noise(NoiseConfig("gaussian", 0.1, 0.0), 1, 3, np.random.default_rng(1))
        rider = driver(policy, noise=noise, safety=Safety())
        rider.tracker.replace([GOAL])
        rider.warm_up()
        simulator = Simulator(SCENARIO)
        simulator.reset(InitialPose(0.0, 0.0, 0.4, 2.5))
        answers = []
        for _ in range(50):
            answers += ride(rider, simulator, 1)
            if warms_up:
                rider.warm_up()
        commands.append(answers)
        assert len(policy.seen) == (100 if warms_up else 50)
    assert commands[0] == commands[1]
    assert (policy.seen[0] == policy.seen[1]).all()


def test_the_policy_sees_the_paper_s_six_states(simulator: Simulator) -> None:
    policy = constant(0.5, 0.1, 0.0)
    rider = driver(policy)
    rider.tracker.replace([GOAL])
    ride(rider, simulator, 2)
    state = simulator.snapshot
    rider.answer(state, 0.05)
    expected = [
        state.steer_angle,
        state.steer_rate,
        state.lean_angle,
        state.lean_rate,
        state.lean_acceleration,
        float(heading_error(state.heading, state.rear_x, state.rear_y, *GOAL)),
    ]
    np.testing.assert_array_equal(policy.seen[-1], [expected])
    assert expected[-1] > 0, "the goal is to the right of heading 0.4"


def test_the_lqr_rides_to_the_goal_and_on(simulator: Simulator) -> None:
    rider = driver(LqrController())
    rider.tracker.replace([(4.0, 14.0)])
    commands = ride(rider, simulator, 600)
    assert not simulator.snapshot.fallen
    assert None not in commands
    goals = [command.goal for command in commands if command]
    assert goals[0] is not None
    assert goals[-1] is None
    assert rider.missed == 0


def test_output_beyond_the_limits_is_cut(simulator: Simulator) -> None:
    rider = driver(constant(9.0, -9.0, 9.0))
    rider.tracker.replace([GOAL])
    command = rider.answer(simulator.snapshot, 0.0).command
    assert command is not None
    assert command.action == (2.0, -0.2, 0.0)


def broken(_: np.ndarray) -> np.ndarray:
    raise RuntimeError("no")


@pytest.mark.parametrize(
    ("policy", "words"),
    [
        (constant(math.nan, 0.0, 0.0), "not finite"),
        (constant(0.0, math.inf, 0.0), "not finite"),
        (Fixed(broken), "RuntimeError"),
        (Fixed(lambda _: np.zeros(3)), "shape"),
    ],
    ids=["nan", "inf", "raises", "shape"],
)
def test_the_fallback_takes_over_from_a_policy_that_fails(
    simulator: Simulator, policy: Fixed, words: str
) -> None:
    lqr = LqrController()
    rider = driver(policy, fallback=lqr)
    rider.tracker.replace([GOAL])
    first = rider.answer(simulator.snapshot, 0.0)
    assert words in first.warning
    assert lqr.policy_id in first.warning
    commands = ride(rider, simulator, 200)
    assert not simulator.snapshot.fallen
    assert {command.policy for command in commands if command} == {lqr.policy_id}
    simulator.step(None)
    assert rider.answer(simulator.snapshot, 9.0).warning == "", "told once"
    assert rider.handed_over == 201


def test_without_fallback_a_failing_policy_means_zero_input(simulator: Simulator) -> None:
    rider = driver(constant(math.nan, 0.0, 0.0))
    rider.tracker.replace([GOAL])
    command = rider.answer(simulator.snapshot, 0.0).command
    assert command is not None
    assert (command.action, command.policy) == ((0.0, 0.0, 0.0), "none")


def test_a_riding_bicycle_is_taken_over_with_its_goal(simulator: Simulator) -> None:
    first = driver(LqrController())
    first.tracker.replace([GOAL])
    ride(first, simulator, 40)
    second = driver(LqrController())
    commands = ride(second, simulator, 40)
    assert {command.goal for command in commands if command} == {GOAL}
    assert None not in commands


def test_a_riding_bicycle_without_goal_is_ridden_straight_on(simulator: Simulator) -> None:
    simulator.step(None)
    rider = driver(LqrController())
    commands = ride(rider, simulator, 200)
    assert None not in commands
    assert not simulator.snapshot.fallen
    assert simulator.snapshot.heading == pytest.approx(0.4, abs=0.1)


def test_by_parameter_a_riding_bicycle_is_left_alone(simulator: Simulator) -> None:
    simulator.step(None)
    rider = driver(LqrController(), take_over=False)
    assert ride(rider, simulator, 5) == [None] * 5


def test_a_fallen_bicycle_gets_no_command(simulator: Simulator) -> None:
    rider = driver(LqrController())
    rider.tracker.replace([GOAL])
    down = replace(simulator.snapshot, fallen=True)
    assert rider.answer(down, 0.0).command is None


def test_noise_repeats_with_its_seed_and_keeps_the_limits(simulator: Simulator) -> None:
    def noisy(seed: int) -> list[Command | None]:
        copy = Simulator.restore(simulator.snapshot, SCENARIO, simulator.plant, 0)
        noise = Noise(NoiseConfig("gaussian", 0.5, 0.0), 1, 3, np.random.default_rng(seed))
        rider = driver(constant(0.0, 0.0, 0.0), noise=noise)
        rider.tracker.replace([GOAL])
        return ride(rider, copy, 30)

    first, again, other = noisy(1), noisy(1), noisy(2)
    assert first == again
    assert first != other
    actions = np.array([command.action for command in first if command])
    assert (np.abs(actions) <= LIMITS).all()
    assert np.std(actions[:, 0]) > 0.3


def test_skipped_steps_are_counted(simulator: Simulator) -> None:
    rider = driver(constant(0.0, 0.0, 0.0))
    rider.tracker.replace([GOAL])
    for step in (0, 1, 5, 6):
        rider.answer(replace(simulator.snapshot, step=step), 0.025 * step)
    assert rider.missed == 3


def under(controller: str, source: CommandSource = CommandSource.FRESH) -> AppliedCommand:
    """The command of a controller that led to a state."""
    return AppliedCommand(source, Command(1, 0, 0.0, 0.0, 0.0, controller=controller))


def test_states_that_another_controller_drives_to_are_not_answered(simulator: Simulator) -> None:
    """Such are the states of a bag that is replayed, too."""
    rider = driver(constant(1.0, 0.1, 0.0), take_over=False)
    rider.tracker.replace([GOAL])
    warnings = []
    for step in range(60):
        # A bag may lead right through the goal.
        state = replace(simulator.snapshot, step=step, rear_x=0.0, rear_y=float(step))
        answer = rider.answer(state, 0.025 * step, under("other"))
        assert answer.command is None
        assert [event.status for event in answer.events] == ([Status.QUEUED] if step == 0 else [])
        warnings += [answer.warning] if answer.warning else []
    assert len(warnings) == 1
    assert "other drives this bicycle" in warnings[0]


def test_the_goal_that_another_one_rode_to_is_told_when_it_is_taken_over(
    simulator: Simulator,
) -> None:
    rider = driver(constant(1.0, 0.1, 0.0))
    rider.tracker.replace([GOAL])
    state = simulator.snapshot
    assert rider.answer(state, 0.0, under("other")).command is None
    late, mine = replace(state, step=1), replace(state, step=2)
    held = under("other", CommandSource.HELD)
    assert rider.answer(late, 0.025, held).command is not None, "the other one is late: be ready"
    answer = rider.answer(mine, 0.05, under("me"))
    assert answer.command is not None
    assert [event.status for event in answer.events] == [Status.ACTIVE]


def test_a_bicycle_that_waits_for_a_dead_controller_is_answered(simulator: Simulator) -> None:
    """In lock-step, and after a watchdog's pause, the same state comes again and again."""
    rider = driver(constant(1.0, 0.1, 0.0))
    rider.tracker.replace([GOAL])
    state = replace(simulator.snapshot, step=7)
    assert rider.answer(state, 0.2, under("other")).command is None
    command = rider.answer(state, 0.2, under("other")).command
    assert command is not None
    assert rider.answer(state, 0.2, under("other")).command is command


def test_the_fallback_knows_the_commands_that_are_under_way() -> None:
    """At 2 m/s and 75 ms of delay the LQR holds the bicycle only because it remembers."""
    known = catalogue.load("browser-rider").parameters
    plant = WhipplePlant(replace(known, delay=0.075, motor=Motor(lag=0.03, limit=7.0)))
    simulator = Simulator(SCENARIO.with_motor(plant.torque_limit), plant)
    simulator.reset(InitialPose(0.0, 0.0, 0.0, 2.0))
    limits = simulator.scenario.action_limits
    lqr = fitting(limits, plant)
    loop = ControlLoop("me", Fixed(broken), GoalTracker(), limits, fallback=lqr, plant=plant)
    loop.tracker.replace([(0.0, 400.0)])
    for step in range(400):
        command = loop.answer(simulator.snapshot, 0.025 * step).command
        assert command is not None
        assert command.policy == lqr.policy_id
        simulator.step(command, 0.2 * (step == 40))
    assert abs(simulator.snapshot.lean_angle) < 0.02


def test_a_state_without_an_echo_is_answered_unless_another_one_drove(
    simulator: Simulator,
) -> None:
    """The driver of a bicycle may not tell what it applied."""
    rider = driver(constant(1.0, 0.1, 0.0), take_over=False)
    rider.tracker.replace([GOAL])
    state = simulator.snapshot
    assert rider.answer(state, 0.0).command is not None
    later, last = replace(state, step=1), replace(state, step=2)
    assert rider.answer(later, 0.025, under("other")).command is None
    assert rider.answer(last, 0.05).command is None, "nothing says that it has gone"
