"""Pace, watchdog and pause, on a clock that the test turns."""

from __future__ import annotations

import math

import pytest
from still_clock import NanosecondClock

from bicycle_common.types import Command, CommandSource, InitialPose
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.runtime.loop import Loop, LoopOptions, StepResult
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named

SCENARIO = named("random-start-random-goal")
START = InitialPose(0.0, 0.0, 0.0, 2.5)
FAR = (0.0, 500.0)
MS = 1_000_000


class Rider:
    """A loop, its clock, and a controller that answers when it is told to."""

    def __init__(self, plant: ChoiPlant | None = None, **options: object) -> None:
        self.clock = NanosecondClock()
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
    stepped = rider.tick()
    assert stepped is not None
    assert (stepped.snapshot.step, stepped.applied.source) == (1, CommandSource.FRESH)
    assert stepped.timing.lateness == 0.0
    assert rider.loop.pacer.dropped == 0


def test_the_newest_command_is_held_until_the_watchdog_lets_go() -> None:
    rider = Rider(watchdog_timeout=0.25)
    rider.answer()
    sources = [stepped.applied.source for stepped in (rider.tick() for _ in range(13)) if stepped]
    assert sources == [CommandSource.FRESH, *[CommandSource.HELD] * 8, *[CommandSource.ZERO] * 4]
    assert rider.loop.timed_out
    rider.answer()
    stepped = rider.tick()
    assert stepped is not None
    assert stepped.applied.source is CommandSource.FRESH
    assert not rider.loop.timed_out


def test_by_parameter_the_watchdog_holds_the_bicycle() -> None:
    rider = Rider(watchdog_timeout=0.25, on_timeout="pause")
    rider.answer()
    stepped = [rider.tick() for _ in range(50)]
    assert sum(one is not None for one in stepped) == 9
    assert rider.loop.waiting
    rider.answer()
    again = rider.tick()
    assert again is not None
    assert (again.snapshot.step, again.applied.source) == (10, CommandSource.FRESH)
    assert rider.loop.pacer.dropped == 0


def test_without_watchdog_a_command_is_held_for_ever() -> None:
    rider = Rider(watchdog_timeout=0.0)
    rider.answer()
    stepped = [rider.tick() for _ in range(40)]
    assert {one.applied.source for one in stepped[1:] if one} == {CommandSource.HELD}


def test_the_watchdog_counts_simulated_time() -> None:
    rider = Rider(watchdog_timeout=0.25, real_time_factor=0.1)
    rider.answer()
    for _ in range(9):
        rider.clock.now += 250 * MS
        stepped = rider.loop.tick()
        assert stepped is not None
        assert stepped.applied.source is not CommandSource.ZERO


def test_lockstep_steps_at_each_answer_and_at_nothing_else() -> None:
    rider = Rider(pace="lockstep")
    for step in range(1, 20):
        rider.clock.now += 3600 * 1000 * MS
        stepped = rider.answer()
        assert stepped is not None
        assert (stepped.snapshot.step, stepped.applied.source) == (step, CommandSource.FRESH)
        assert math.isnan(stepped.timing.lateness)
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
        assert rider.loop.validator.newest == late(step), "it was let in, for what it is"
    stepped = rider.answer()
    assert stepped is not None
    assert (stepped.snapshot.step, stepped.applied.source) == (5, CommandSource.FRESH)


def test_a_pause_makes_no_step_and_no_delay() -> None:
    rider = Rider()
    rider.answer()
    rider.tick()
    rider.loop.pause(True)
    assert [rider.tick() for _ in range(40)] == [None] * 40
    rider.loop.pause(False)
    stepped = rider.tick()
    assert stepped is not None
    assert stepped.applied.source is CommandSource.HELD, "the pause is no silence"
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
    sources = [first.applied.source, second.applied.source]
    assert sources == [CommandSource.FRESH, CommandSource.ZERO]


def test_lockstep_goes_on_after_a_pause_with_the_answer_that_came_meanwhile() -> None:
    rider = Rider(pace="lockstep")
    rider.loop.pause(True)
    assert rider.answer() is None
    stepped = rider.loop.pause(False)
    assert stepped is not None
    assert stepped.snapshot.step == 1


def test_after_a_fall_nothing_moves_until_a_reset() -> None:
    rider = Rider(pace="lockstep")
    stepped = None
    while not rider.loop.snapshot.fallen:
        stepped = rider.answer(torque=2.0)
    assert stepped is not None
    assert stepped.snapshot.fallen
    assert rider.answer() is None
    rider.loop.reset(START, None)
    assert rider.answer() is not None


def test_latency_runs_from_the_last_publication() -> None:
    rider = Rider(pace="lockstep")
    rider.loop.published()
    rider.clock.now += 3 * MS
    stepped = rider.answer()
    assert stepped is not None
    assert stepped.latency == pytest.approx(0.003)


def test_an_old_answer_tells_no_latency() -> None:
    rider = Rider()
    rider.answer()
    for _ in range(2):
        rider.tick()
    assert rider.loop.receive(late(1)) == ("", None)
    stepped = rider.tick()
    assert stepped is not None
    assert math.isnan(stepped.latency)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"pace": "fast"}, "realtime or lockstep"),
        ({"on_timeout": "stop"}, "zero, steer_into_lean or pause"),
        ({"watchdog_timeout": -1.0}, "zero or more"),
        ({"watchdog_timeout": 0.05}, "0 for never, or 0.1 s or more"),
        ({"watchdog_timeout": math.nan}, "zero or more"),
        ({"real_time_factor": 0.0}, "above zero"),
    ],
)
def test_a_bad_option_is_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Rider(**options)  # type: ignore[arg-type]
