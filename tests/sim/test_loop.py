"""Pace, watchdog, pause and transitions, on a clock that the test turns."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bicycle_common.types import Command, CommandSource, InitialPose
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.runtime.loop import Loop, LoopOptions, StepResult
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named
from bicycle_sim.task.task import BicycleTask

SCENARIO = named("random-start-random-goal")
START = InitialPose(0.0, 0.0, 0.0, 2.5)
FAR = (0.0, 500.0)
MS = 1_000_000


class Clock:
    def __init__(self) -> None:
        self.now = 5_000 * MS

    def __call__(self) -> int:
        return self.now


class Rider:
    """A loop, its clock, and a controller that answers when it is told to."""

    def __init__(self, plant: ChoiPlant | None = None, **options: object) -> None:
        self.clock = Clock()
        simulator = Simulator(SCENARIO, plant)
        self.loop = Loop(simulator, LoopOptions(**options), self.clock)  # type: ignore[arg-type]
        self.loop.reset(START, None)

    def answer(
        self, torque: float = 0.0, goal: tuple[float, float] | None = FAR, goal_id: int = 1
    ) -> StepResult | None:
        state = self.loop.snapshot
        command = Command(
            state.episode, state.step, torque, 0.0, 0.0, goal, goal_id, "me", "policy"
        )
        return self.loop.receive(command)[1]

    def tick(self) -> StepResult | None:
        self.clock.now += 25 * MS
        return self.loop.tick()


def test_the_bicycle_is_held_until_the_first_command() -> None:
    rider = Rider()
    assert [rider.tick() for _ in range(100)] == [None] * 100
    assert rider.loop.waiting
    assert rider.answer() is None, "in real time the step waits for its time"
    made = rider.tick()
    assert made is not None
    assert (made.snapshot.step, made.snapshot.command_source) == (1, CommandSource.FRESH)
    assert made.timing.lateness == 0.0
    assert rider.loop.pacer.dropped == 0


def test_the_newest_command_is_held_until_the_watchdog_lets_go() -> None:
    rider = Rider(watchdog_timeout=0.25)
    rider.answer()
    sources = [made.snapshot.command_source for made in (rider.tick() for _ in range(13)) if made]
    assert sources == [CommandSource.FRESH, *[CommandSource.HELD] * 8, *[CommandSource.ZERO] * 4]
    assert rider.loop.timed_out
    rider.answer()
    made = rider.tick()
    assert made is not None
    assert made.snapshot.command_source is CommandSource.FRESH
    assert not rider.loop.timed_out


def test_by_parameter_the_watchdog_holds_the_bicycle() -> None:
    rider = Rider(watchdog_timeout=0.25, on_timeout="pause")
    rider.answer()
    made = [rider.tick() for _ in range(50)]
    assert sum(one is not None for one in made) == 9
    assert rider.loop.waiting
    rider.answer()
    again = rider.tick()
    assert again is not None
    assert (again.snapshot.step, again.snapshot.command_source) == (10, CommandSource.FRESH)
    assert rider.loop.pacer.dropped == 0


def test_without_watchdog_a_command_is_held_for_ever() -> None:
    rider = Rider(watchdog_timeout=0.0)
    rider.answer()
    made = [rider.tick() for _ in range(40)]
    assert {one.snapshot.command_source for one in made[1:] if one} == {CommandSource.HELD}


def test_the_watchdog_counts_simulated_time() -> None:
    rider = Rider(watchdog_timeout=0.25, real_time_factor=0.1)
    rider.answer()
    for _ in range(9):
        rider.clock.now += 250 * MS
        made = rider.loop.tick()
        assert made is not None
        assert made.snapshot.command_source is not CommandSource.ZERO


def test_lockstep_steps_at_each_answer_and_at_nothing_else() -> None:
    rider = Rider(pace="lockstep")
    for step in range(1, 20):
        rider.clock.now += 3600 * 1000 * MS
        made = rider.answer()
        assert made is not None
        assert (made.snapshot.step, made.snapshot.command_source) == (step, CommandSource.FRESH)
        assert math.isnan(made.timing.lateness)
        repeated = Command(1, step - 1, 0.5, 0.0, 0.0, FAR, 1, "me")
        assert rider.loop.receive(repeated) == ("", None)


def late(step: int) -> Command:
    """Return the answer to a state that is past."""
    return Command(1, step, 0.5, 0.0, 0.0, FAR, 1, "me")


def test_an_old_answer_makes_no_step_in_lockstep() -> None:
    rider = Rider(pace="lockstep")
    rider.loop.pause(True)
    for _ in range(4):
        assert rider.loop.single_step() is not None
    assert rider.loop.receive(late(0)) == ("", None)
    assert rider.loop.pause(False) is None, "the answer that came meanwhile is an old one"
    for step in (1, 2, 3):
        assert rider.loop.receive(late(step)) == ("", None)
        assert rider.loop.gate.newest == late(step), "it was let in, for what it is"
    made = rider.answer()
    assert made is not None
    assert (made.snapshot.step, made.snapshot.command_source) == (5, CommandSource.FRESH)


def test_a_pause_makes_no_step_and_no_delay() -> None:
    rider = Rider()
    rider.answer()
    rider.tick()
    rider.loop.pause(True)
    assert [rider.tick() for _ in range(40)] == [None] * 40
    rider.loop.pause(False)
    made = rider.tick()
    assert made is not None
    assert made.snapshot.command_source is CommandSource.HELD, "the pause is no silence"
    assert rider.loop.pacer.dropped == 0


@pytest.mark.parametrize("pace", ["realtime", "lockstep"])
def test_single_steps_while_paused(pace: str) -> None:
    rider = Rider(pace=pace)
    assert rider.loop.single_step() is None, "not paused"
    rider.loop.pause(True)
    assert rider.answer() is None
    first, second = rider.loop.single_step(), rider.loop.single_step()
    assert first is not None
    assert second is not None
    sources = [first.snapshot.command_source, second.snapshot.command_source]
    assert sources == [CommandSource.FRESH, CommandSource.ZERO]


def test_lockstep_goes_on_after_a_pause_with_the_answer_that_came_meanwhile() -> None:
    rider = Rider(pace="lockstep")
    rider.loop.pause(True)
    assert rider.answer() is None
    made = rider.loop.pause(False)
    assert made is not None
    assert made.snapshot.step == 1


def test_after_a_fall_nothing_moves_until_a_reset() -> None:
    rider = Rider(pace="lockstep")
    made = None
    while not rider.loop.snapshot.fallen:
        made = rider.answer(torque=2.0)
    assert made is not None
    assert made.transitions[-1].fallen
    assert rider.answer() is None
    rider.loop.reset(START, None)
    assert rider.answer() is not None


def test_transitions_are_the_tasks() -> None:
    task = BicycleTask(SCENARIO, rng=np.random.default_rng(0))
    task.place(np.array([True]), *(np.array([value]) for value in (0.0, 0.0, 0.3, FAR[0], FAR[1])))
    rider = Rider(pace="lockstep")
    rider.loop.reset(InitialPose(0.0, 0.0, 0.3, SCENARIO.start_speed), None)
    torques = [0.1, -0.2, 0.3, 0.05, -0.1]
    made = [rider.answer(torque) for torque in torques]
    transitions = [one for step in made if step for one in step.transitions] + rider.loop.close()
    assert len(transitions) == len(torques)
    before = task.observation()[0]
    for torque, transition in zip(torques, transitions, strict=True):
        step = task.step(np.array([[torque, 0.0, 0.0]]))
        np.testing.assert_array_equal(transition.observation, before)
        np.testing.assert_array_equal(transition.next_observation, step.observation[0])
        assert transition.reward == step.reward[0]
        assert transition.speed == SCENARIO.start_speed
        assert not transition.terminated
        before = step.observation[0]
    assert [one.truncated for one in transitions] == [False] * 4 + [True]


def test_a_new_goal_cuts_and_a_reached_one_ends() -> None:
    rider = Rider(pace="lockstep")
    first = rider.answer(goal=FAR, goal_id=1)
    second = rider.answer(goal=(0.0, 0.0), goal_id=2)
    assert first is not None
    assert second is not None
    assert first.transitions == []
    cut, reached = second.transitions
    assert (cut.goal_id, cut.truncated, cut.terminated) == (1, True, False)
    assert (reached.goal_id, reached.truncated, reached.terminated) == (2, False, True)


def test_a_fall_inside_the_goal_is_not_counted_as_reached() -> None:
    rider = Rider(pace="lockstep")
    made: StepResult | None = None
    while made is None or not made.snapshot.fallen:
        last = rider.loop.snapshot
        made = rider.answer(torque=1.0, goal=(last.rear_x, last.rear_y), goal_id=last.step)
    *_, fell = made.transitions
    assert (fell.fallen, fell.terminated) == (True, False)
    at = made.snapshot
    assert math.dist(fell.goal, (at.rear_x, at.rear_y)) < rider.loop.simulator.scenario.goal_radius


def test_steps_without_a_goal_or_a_command_are_no_transitions() -> None:
    rider = Rider(watchdog_timeout=0.1)
    rider.answer()
    made = [one for one in (rider.tick() for _ in range(6)) if one]
    transitions = [one for step in made for one in step.transitions]
    assert [one.step for one in transitions] == [0, 1, 2]
    assert transitions[-1].truncated
    assert rider.loop.close() == []


def test_latency_runs_from_the_last_publication() -> None:
    rider = Rider(pace="lockstep")
    rider.loop.published()
    rider.clock.now += 3 * MS
    made = rider.answer()
    assert made is not None
    assert made.latency == pytest.approx(0.003)


def test_an_old_answer_tells_no_latency() -> None:
    rider = Rider()
    rider.answer()
    for _ in range(2):
        rider.tick()
    assert rider.loop.receive(late(1)) == ("", None)
    made = rider.tick()
    assert made is not None
    assert math.isnan(made.latency)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"pace": "fast"}, "realtime or lockstep"),
        ({"on_timeout": "stop"}, "zero or pause"),
        ({"watchdog_timeout": -1.0}, "zero or more"),
        ({"watchdog_timeout": 0.05}, "0 for never, or 0.1 s or more"),
        ({"watchdog_timeout": math.nan}, "zero or more"),
        ({"real_time_factor": 0.0}, "above zero"),
    ],
)
def test_a_bad_option_is_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Rider(**options)  # type: ignore[arg-type]
