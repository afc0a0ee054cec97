"""Episodes that are learned from, whatever order announcements and states come in."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from bicycle_common.nodes import convert
from bicycle_common.types import Command, InitialPose
from bicycle_controller.data import live_steps
from bicycle_controller.data.announced_episodes import AnnouncedEpisodes
from bicycle_controller.data.live_steps import LiveSteps
from bicycle_sim.plants import registry
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named

SCENARIO = named("random-start-random-goal")


@pytest.mark.parametrize(
    ("announced", "begun", "found"),
    [
        ([(1, True)], [1], [True]),
        ([(1, False)], [1], [False]),
        ([], [1], [None]),
        # The number of another simulator's first episode returns.
        ([(1, True), (2, True), (1, False)], [1, 2, 1], [True, True, False]),
        ([(1, True)], [1, 1], [True, None]),
        # The announcement of 6 was lost; that of 7 is the same simulator's.
        ([(5, True), (7, True)], [5, 6, 7], [True, True, True]),
        # No state of 6 came: the next simulator's first episode is not taken for it.
        ([(6, True), (1, False)], [1], [False]),
    ],
)
def test_an_announcement_counts_for_one_episode(
    announced: Sequence[tuple[int, bool]], begun: Sequence[int], found: Sequence[bool | None]
) -> None:
    episodes = AnnouncedEpisodes()
    for episode, learned in announced:
        episodes.announce(episode, learned)
    assert [episodes.begin(episode) for episode in begun] == found


def ride(steps: LiveSteps, count: int) -> None:
    """Publish the states of a fresh simulator's first episode."""
    simulator = Simulator(SCENARIO, registry.named("choi", None, "faithful"))
    simulator.reset(InitialPose(0.0, 0.0, 0.0, SCENARIO.start_speed))
    for number in range(count):
        here, applied = simulator.snapshot, simulator.applied
        steps.add_echo(convert.from_applied(applied, here.episode, here.step, 0))
        steps.add_state(convert.from_snapshot(here, 0))
        simulator.step(Command(here.episode, number, 0.0, 0.0, 0.0, (0.0, 500.0), 1, "me", "p"))


def test_states_wait_for_the_word_of_another_bicycle() -> None:
    steps = LiveSteps(AnnouncedEpisodes())
    ride(steps, 5)
    assert len(steps.take()["step"]) == 0
    steps.announce(1, True)
    assert len(steps.take()["step"]) == 5
    ride(steps, 5)
    assert len(steps.take()["step"]) == 0, "another simulator, which has not told what it rides"
    steps.announce(1, False)
    assert len(steps.take()["step"]) == 0
    ride(steps, 3)
    steps.announce(1, True)
    assert steps.take()["step"].tolist() == [0, 1, 2]


def test_a_simulator_that_had_not_ridden_is_not_taken_for_the_next_one() -> None:
    """Both stand at the same first state of their first episode."""
    steps = LiveSteps(AnnouncedEpisodes())
    steps.announce(1, True)
    ride(steps, 1)
    assert len(steps.take()["step"]) == 1
    steps.announce(1, False)
    ride(steps, 5)
    assert len(steps.take()["step"]) == 0
    steps.announce(1, True)
    ride(steps, 3)
    found = steps.take()
    assert found["step"].tolist() == [0, 1, 2]
    assert len(set(found["run"])) == 1


def test_an_announcement_that_comes_after_its_states_parts_nothing() -> None:
    steps = LiveSteps(AnnouncedEpisodes())
    ride(steps, 3)
    steps.announce(1, True)
    assert steps.take()["step"].tolist() == [0, 1, 2]
    steps.announce(2, True)
    assert len(steps.take()["step"]) == 0


def test_an_episode_that_is_never_announced_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_steps, "MOST_UNANNOUNCED", 10)
    steps = LiveSteps(AnnouncedEpisodes())
    ride(steps, 12)
    assert len(steps.take()["step"]) == 0
    ride(steps, 4)
    steps.announce(1, True)
    assert steps.take()["step"].tolist() == [0, 1, 2, 3]
