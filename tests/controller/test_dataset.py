"""Recorded rides as data: both ways of reading give the same, and bad data are refused."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from clocks import CLOCKS, with_clock
from ride_bag_maker import SCENARIO, Message, Rider, write_bag

from bicycle_common.types import CommandSource
from bicycle_controller.config import loading
from bicycle_controller.config.algorithms import DdpgConfig
from bicycle_controller.data import dataset
from bicycle_controller.data.dataset import Dataset
from bicycle_controller.data.dataset_report import as_text, report
from bicycle_controller.data.replay_buffer import NStepAccumulator, RewardShaping
from bicycle_controller.data.transition_builder import Transitions
from bicycle_sim.task.scenario import SCENARIOS

STEPS = 1200
STATE, COMMAND, ECHO = "/bicycle/state", "/bicycle/command", "/bicycle/command_echo"
EPISODE = "/bicycle/episode"


@pytest.fixture(scope="module")
def ride() -> list[Message]:
    """Half a minute with falls, a goal now and then, and all that a recorder hears of it."""
    return list(Rider(sigma=0.25, seed=0, field=8.0).ride(STEPS))


@pytest.fixture(scope="module")
def recorded(ride: list[Message], tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return dataset.load([write_bag(tmp_path_factory.mktemp("a") / "bag", iter(ride))])


def offline_ddpg(*overrides: str) -> DdpgConfig:
    ddpg = loading.preset("offline", overrides).ddpg
    assert ddpg is not None
    return ddpg


def without(ride: list[Message], topic: str, steps: set[int]) -> Iterator[Message]:
    """Yield the ride without some messages of a topic, by their place among them."""
    count = -1
    for message in ride:
        if message[0] == topic:
            count += 1
            if count in steps:
                continue
        yield message


def assert_equal(one: Transitions, other: Transitions) -> None:
    for name, column in vars(one).items():
        if name != "time":
            assert np.array_equal(column, getattr(other, name)), name


def test_the_ride_holds_what_the_tests_are_about(recorded: Dataset) -> None:
    found = recorded.transitions
    assert STEPS - 100 < len(found) <= STEPS
    assert found.fallen.sum() >= 3
    assert found.terminated.sum() >= 1
    assert (found.truncated & ~found.fallen & ~found.terminated).sum() >= 1
    assert not recorded.sources[0].recorded
    assert recorded.lost == {"states": 0, "commands": 0}
    assert recorded.scenario == SCENARIO


def test_without_echoes_each_answer_is_taken_for_applied(
    ride: list[Message], recorded: Dataset, tmp_path: Path
) -> None:
    """A bicycle's driver may publish no echoes; in lock-step the assumption is exact."""
    guessed = dataset.load([write_bag(tmp_path / "bag", iter(ride), [ECHO])])
    assert guessed.lost == {"states": 0, "commands": 0}
    assert_equal(recorded.transitions, guessed.transitions)


def test_a_fall_inside_the_goal_is_not_counted_as_reached(
    ride: list[Message], tmp_path: Path
) -> None:
    """Every bicycle that falls has its goal where it lies."""
    falls = {
        (message.episode, message.step - 1): message.rear_contact
        for topic, message, _ in ride
        if topic == STATE and message.fallen
    }
    assert len(falls) >= 3
    moved = copy.deepcopy(ride)
    for topic, message, _ in moved:
        if topic == ECHO and (place := falls.get((message.episode, message.step - 1))):
            message.command.goal, message.command.has_goal = place, True
    found = dataset.load([write_bag(tmp_path / "bag", iter(moved))]).transitions
    keys = list(zip(found.episode.tolist(), found.step.tolist(), strict=True))
    rows = [row for row, key in enumerate(keys) if key in falls]
    assert len(rows) == len(falls)
    assert found.fallen[rows].all()
    assert not found.terminated[rows].any()


def test_a_lost_state_costs_the_two_steps_beside_it_and_cuts_before_it(
    ride: list[Message], recorded: Dataset, tmp_path: Path
) -> None:
    whole = recorded.transitions
    states = [message for topic, message, _ in ride if topic == STATE]
    # A state in the middle of a pursuit, as the transitions know it.
    row = next(i for i in range(300, len(whole)) if not whole.ended[i - 3 : i + 3].any())
    place = next(
        i
        for i, state in enumerate(states)
        if (state.episode, state.step) == (whole.episode[row], whole.step[row])
    )
    bag = write_bag(tmp_path / "bag", without(ride, STATE, {place}))
    found = dataset.load([bag])
    keep = np.ones(len(whole), dtype=bool)
    keep[[row - 1, row]] = False
    expected = Transitions(**{name: column[keep] for name, column in vars(whole).items()})
    truncated = expected.truncated.copy()
    truncated[row - 2] = True
    assert_equal(found.transitions, replace(expected, truncated=truncated))
    assert found.lost == {"states": 1, "commands": 0}


def test_a_lost_echo_costs_one_step(
    ride: list[Message], recorded: Dataset, tmp_path: Path
) -> None:
    found = dataset.load([write_bag(tmp_path / "bag", without(ride, ECHO, {400}))])
    assert found.lost == {"states": 0, "commands": 1}
    assert len(found.transitions) == len(recorded.transitions) - 1


def test_a_lost_command_costs_nothing(
    ride: list[Message], recorded: Dataset, tmp_path: Path
) -> None:
    found = dataset.load([write_bag(tmp_path / "bag", without(ride, COMMAND, {400}))])
    assert found.lost == {"states": 0, "commands": 0}
    assert_equal(recorded.transitions, found.transitions)


def test_a_held_command_is_the_action_of_the_steps_that_it_ruled(tmp_path: Path) -> None:
    def late(messages: Iterator[Message]) -> Iterator[Message]:
        """Return the ride as if the answer to step 20 were late and the one to 19 held."""
        for topic, message, time in messages:
            if topic == ECHO and message.step == 21:
                message.command_source = int(CommandSource.HELD)
                message.command.step = 19
            if topic == ECHO and message.step in (20, 21):
                message.command.torque = 1.25
            yield topic, message, time

    bag = write_bag(tmp_path / "bag", late(Rider(sigma=0.1, seed=1).ride(60)))
    found = dataset.load([bag]).transitions
    assert found.action[found.step == 20, 0].tolist() == [1.25]
    assert found.action[found.step == 19, 0].tolist() == [1.25]


def test_a_restarted_simulator_counts_anew_and_nothing_is_mixed_up(tmp_path: Path) -> None:
    def both() -> Iterator[Message]:
        for part, seed in enumerate((1, 2)):
            for topic, message, time in Rider(sigma=0.1, seed=seed).ride(80):
                yield topic, message, time + part * 10**10

    apart = [
        dataset.load([write_bag(tmp_path / f"{seed}", Rider(sigma=0.1, seed=seed).ride(80))])
        for seed in (1, 2)
    ]
    expected = Transitions.join([data.transitions for data in apart])
    for name, left_out in (("echoed", []), ("guessed", [ECHO])):
        found = dataset.load([write_bag(tmp_path / name, both(), left_out)])
        assert_equal(found.transitions, expected)


def test_a_folder_of_bags_is_read_in_order_and_joined(tmp_path: Path) -> None:
    for name, left_out in (("b", [ECHO]), ("a/deep", [])):
        write_bag(tmp_path / "bags" / name, Rider(sigma=0.1, seed=1).ride(60), left_out)
    data = dataset.load([tmp_path / "bags"])
    assert [Path(source.path).name for source in data.sources] == ["deep", "b"]
    assert len(data.transitions) == 2 * data.sources[0].transitions


# The memory.


@pytest.mark.parametrize("n_step", [1, 5])
def test_the_memory_gets_what_stepping_through_the_ride_gives(
    recorded: Dataset, n_step: int
) -> None:
    ddpg = offline_ddpg(f"ddpg.n_step={n_step}")
    rows = dataset.memory_rows(recorded, ddpg)
    found, limits = recorded.transitions, recorded.scenario.action_limits
    returns = NStepAccumulator(1, 2, RewardShaping.of(ddpg))
    parts = [
        returns.push(
            found.observation[i : i + 1],
            found.action[i : i + 1, :2] / limits[:2],
            found.reward[i : i + 1],
            found.next_observation[i : i + 1],
            *(flags[i : i + 1] for flags in (found.terminated, found.truncated, found.fallen)),
        )
        for i in range(len(found))
    ]
    expected = np.concatenate(parts)
    assert len(rows) == len(found)
    assert np.array_equal(np.unique(rows, axis=0), np.unique(expected, axis=0))


def test_lanes_hold_whole_pursuits_once_each() -> None:
    rng = np.random.default_rng(0)
    ended = rng.random(5000) < 0.02
    ended[-1] = True
    lanes = dataset.lanes_of(ended, 16)
    assert lanes.shape[1] <= 16
    assert sorted(lanes[lanes >= 0].tolist()) == list(range(5000))
    for lane in lanes.T:
        rows = lane[lane >= 0]
        assert np.array_equal(rows, np.arange(rows[0], rows[0] + len(rows)))
        assert ended[rows[-1]]
    assert lanes.shape[0] < 3 * 5000 / 16


def test_frozen_falls_are_refused(recorded: Dataset) -> None:
    with pytest.raises(ValueError, match=r"set ddpg\.fall=absorbing"):
        dataset.memory_rows(recorded, offline_ddpg("ddpg.fall=frozen"))


# The report, and what is refused.


def test_the_report_counts_what_is_there(recorded: Dataset) -> None:
    found, rides = report(recorded), recorded.transitions
    assert found["transitions"] == len(rides)
    assert found["minutes"] == pytest.approx(len(rides) / 2400)
    assert (found["goals"], found["falls"]) == (rides.terminated.sum(), rides.fallen.sum())
    assert found["fall_share"] == pytest.approx(rides.fallen.sum() / rides.ended.sum())
    assert list(found["actions"]) == ["torque", "displacement"]
    torque = found["actions"]["torque"]
    assert torque["range"] == [rides.action[:, 0].min(), rides.action[:, 0].max()]
    assert sum(torque["histogram"]) == len(rides)
    assert torque["at_limit"] == pytest.approx((np.abs(rides.action[:, 0]) >= 2.0).mean())
    assert np.array(found["coverage"]).shape == (9, 24)
    assert np.sum(found["coverage"]) == len(rides)
    assert sum(found["policies"].values()) == len(rides)
    assert all(name.startswith("lqr-") for name in found["policies"])
    assert f"{len(rides):,} transitions" in as_text(found)


def test_the_report_sees_where_the_clock_stood_still(
    ride: list[Message], recorded: Dataset, tmp_path: Path
) -> None:
    assert report(recorded)["clock_gaps"] == 0
    late = (
        (topic, m, time + (5 * 10**9 if i > 2000 else 0))
        for i, (topic, m, time) in enumerate(ride)
    )
    assert report(dataset.load([write_bag(tmp_path / "bag", late)]))["clock_gaps"] == 1


def changed(data: Dataset, **columns: Any) -> Dataset:
    return replace(data, transitions=replace(data.transitions, **columns))


def test_bad_data_are_refused_in_one_line(recorded: Dataset) -> None:
    assert dataset.check(recorded, 1000) == []
    with pytest.raises(ValueError, match=r"too few .* at least 5000 are needed: record 2 minutes"):
        dataset.check(recorded)
    action = recorded.transitions.action.copy()
    action[7, 1] = 0.25
    with pytest.raises(ValueError, match=r"beyond the limits .*displacement within 0\.2"):
        dataset.check(changed(recorded, action=action), 1000)
    reward = recorded.transitions.reward.copy()
    reward[3] = np.nan
    with pytest.raises(ValueError, match="1 transitions hold a reward that is not finite"):
        dataset.check(changed(recorded, reward=reward), 1000)
    nothing = np.zeros(len(reward), dtype=bool)
    (line,) = dataset.check(changed(recorded, fallen=nothing), 1000)
    assert line.startswith("no falls in the data")


def test_bags_that_will_not_do_are_refused_in_one_line(
    ride: list[Message], tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match="there is no bag"):
        dataset.load([tmp_path / "nowhere"])
    with pytest.raises(ValueError, match="holds no bag"):
        dataset.load([tmp_path])
    mute = write_bag(tmp_path / "mute", iter(ride), [EPISODE])
    with pytest.raises(ValueError, match="name it with --scenario"):
        dataset.load([mute])
    assert len(dataset.load([mute], SCENARIO).transitions) > 1000
    empty = write_bag(tmp_path / "empty", iter(ride), [STATE])
    with pytest.raises(ValueError, match="holds no bicycle"):
        dataset.load([empty])
    other = replace(SCENARIOS["random-small-displacement"], max_steps=SCENARIO.max_steps)
    narrow = write_bag(tmp_path / "narrow", Rider(scenario=other).ride(30))
    with pytest.raises(ValueError, match="learn from each alone"):
        dataset.load([mute.parent / "narrow", write_bag(tmp_path / "wide", iter(ride))])
    assert narrow.exists()


@pytest.mark.parametrize("leave_out", [(), (ECHO,)], ids=["echoed", "guessed"])
@pytest.mark.parametrize("name", CLOCKS)
def test_the_recordings_clock_does_not_matter(
    ride: list[Message], tmp_path: Path, name: str, leave_out: tuple[str, ...]
) -> None:
    """Two lives of a simulator, so that steps and episodes occur twice."""
    sound = write_bag(tmp_path / "sound", iter(ride + ride), leave_out)
    other = with_clock(sound, tmp_path / "other", CLOCKS[name], publishers=True)
    found, wanted = dataset.load([other]), dataset.load([sound])
    assert len(found.transitions) > STEPS
    assert found.lost == wanted.lost
    assert_equal(found.transitions, wanted.transitions)
