"""Verification of rides that are made here, message by message: what is proved, what is not."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
from bicycle_msgs.msg import BicycleCommand, CommandEcho, EpisodeInfo
from changed_ride import (
    COMMANDS,
    ECHOES,
    EPISODES,
    PUSHES,
    STATES,
    STEPS,
    Change,
    changed,
    judged,
    recorded,
    with_field,
    without,
)
from ride_bag_maker import PERIOD_NS, Message, Rider

from bicycle_bag.errors import BagError
from bicycle_common.nodes import convert
from bicycle_common.types import Push
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.runtime.simulator import Simulator
from bicycle_tools.nodes import ride_recording, verify_states
from bicycle_tools.nodes.verify_states import StateVerdict

pytestmark = pytest.mark.ros


@pytest.mark.parametrize("prefix", ["", "/red"])
def test_a_sound_ride_is_proved(ride: list[Message], tmp_path: Path, prefix: str) -> None:
    verdict = judged(tmp_path / "bag", ride, prefix)
    assert verdict == StateVerdict(checked=STEPS, begun=1, led=True)
    assert verdict.same
    assert verdict.proved
    assert str(verdict) == "60 states came out again, bit for bit"


def test_each_state_brings_a_verdict(ride: list[Message], tmp_path: Path) -> None:
    recording = ride_recording.read(recorded(tmp_path / "bag", ride))
    counts = [verdict.checked for verdict in verify_states.verify(recording)]
    assert len(counts) == STEPS + 1
    assert counts[-1] == STEPS


@pytest.mark.parametrize(
    ("topic", "field", "at"),
    [
        *(
            (STATES, field, 21)
            for field in (
                "lean_angle",
                "lean_rate",
                "steer_angle",
                "steer_rate",
                "speed",
                "heading",
                "yaw_rate",
                "pitch",
                "lean_acceleration",
                "front_contact.x",
                "rear_contact.y",
            )
        ),
        (COMMANDS, "torque", 20),
        (COMMANDS, "displacement", 20),
        (COMMANDS, "pedal_force", 20),
    ],
)
def test_a_number_that_is_not_so_is_found(
    ride: list[Message], tmp_path: Path, topic: str, field: str, at: int
) -> None:
    forged = changed(ride, with_field(topic, at, field, lambda value: value + 1e-3))
    verdict = judged(tmp_path / "bag", forged)
    assert not verdict.same
    assert verdict.checked == 20
    assert verdict.unknown == verdict.rounded == 0
    assert verdict.difference.startswith("step 21 of episode 1: ")
    name = f"{field} was" if topic == STATES else " was "
    assert name in verdict.difference
    apart = verdict.difference.rpartition(", ")[2]
    assert apart == "0.001 apart" if topic == STATES else apart.endswith(" apart")
    assert str(verdict) == f"not the same after 20 equal states: {verdict.difference}"


def test_it_ends_at_the_first_difference(ride: list[Message], tmp_path: Path) -> None:
    forged = changed(ride, with_field(STATES, 21, "lean_rate", lambda value: value + 1.0))
    verdicts = list(verify_states.verify(ride_recording.read(recorded(tmp_path / "bag", forged))))
    assert len(verdicts) == 22


@pytest.mark.parametrize("field", ["fallen", "estimated"])
def test_a_mark_that_is_not_so_is_found(ride: list[Message], tmp_path: Path, field: str) -> None:
    verdict = judged(tmp_path / "bag", changed(ride, with_field(STATES, 21, field, True)))
    assert f"step 21 of episode 1: {field} was True and comes out as False" in verdict.difference
    assert "apart" not in verdict.difference


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("command_source", int(CommandEcho.SOURCE_HELD)),
        ("command.torque", 0.25),
        ("command.goal.x", 77.0),
        ("command.policy", "another"),
        ("command.goal_id", 99),
    ],
)
def test_an_echo_that_is_not_so_is_found(
    ride: list[Message], tmp_path: Path, field: str, value: Any
) -> None:
    verdict = judged(tmp_path / "bag", changed(ride, with_field(ECHOES, 21, field, value)))
    assert f"step 21 of episode 1: echo.{field} was {value!r}" in verdict.difference


def test_rounding_is_told_and_goes_on_from_the_recorded_state(
    ride: list[Message], tmp_path: Path
) -> None:
    rounded = changed(ride, with_field(STATES, 21, "lean_acceleration", lambda old: old + 2e-13))
    verdict = judged(tmp_path / "bag", rounded)
    assert verdict.same
    assert not verdict.proved
    assert (verdict.checked, verdict.rounded) == (STEPS, 1)
    assert verdict.largest == pytest.approx(2e-13, rel=1e-2)
    assert str(verdict) == (
        "60 states came out again, bit for bit but for 1 that differ by 2e-13 at most, as another "
        "kind of processor rounds"
    )


def test_each_rounded_state_counts(ride: list[Message], tmp_path: Path) -> None:
    rounded = ride
    for step in (21, 31, 41):
        change = with_field(STATES, step, "lean_acceleration", lambda old: old + 2e-13)
        rounded = changed(rounded, change)
    verdict = judged(tmp_path / "bag", rounded)
    assert (verdict.checked, verdict.rounded) == (STEPS, 3)


@pytest.mark.parametrize(("apart", "same"), [(0.98e-9, True), (1.02e-9, False), (2e-9, False)])
def test_rounding_ends_at_a_billionth(
    ride: list[Message], tmp_path: Path, apart: float, same: bool
) -> None:
    forged = changed(ride, with_field(STATES, 21, "lean_acceleration", lambda old: old + apart))
    assert judged(tmp_path / "bag", forged).same == same


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
def test_no_number_is_no_rounding(ride: list[Message], tmp_path: Path, wrong: float) -> None:
    forged = changed(ride, with_field(STATES, 21, "lean_acceleration", wrong))
    verdict = judged(tmp_path / "bag", forged)
    assert f"lean_acceleration was {wrong!r}" in verdict.difference


@pytest.mark.parametrize("topic", [COMMANDS, ECHOES])
def test_a_missing_command_is_told(ride: list[Message], tmp_path: Path, topic: str) -> None:
    """A sent command without its echo is missed too, for the echo alone proves nothing."""
    steps = (30, 40) if topic == COMMANDS else (31, 41)
    verdict = judged(tmp_path / "bag", changed(ride, without(topic, *steps)))
    assert (verdict.checked, verdict.unknown, verdict.head) == (STEPS - 2, 2, 0)
    assert verdict.first_unknown == "step 31 of episode 1"
    assert not verdict.same
    assert str(verdict) == (
        "not proved: 58 states came out again, bit for bit, but 2 could not be computed for lack "
        "of the state or command before, first step 31 of episode 1"
    )


def test_a_missing_state_is_told(ride: list[Message], tmp_path: Path) -> None:
    verdict = judged(tmp_path / "bag", changed(ride, without(STATES, 30, 40)))
    assert (verdict.checked, verdict.begun) == (STEPS - 4, 1)
    assert (verdict.unknown, verdict.first_unknown) == (2, "step 31 of episode 1")


def later(state: int, command: int) -> Change:
    """Leave out states and commands before these steps, as a recorder that joins late does."""

    def change(name: str, message: Any) -> Iterator[tuple[str, Any]]:
        first = {STATES: state, ECHOES: state, COMMANDS: command}.get(name, 0)
        if name == EPISODES or message.step >= first:
            yield name, message

    return change


def test_a_recording_that_begins_late_is_proved_from_there(
    ride: list[Message], tmp_path: Path
) -> None:
    verdict = judged(tmp_path / "bag", changed(ride, later(20, 20)))
    assert verdict == StateVerdict(checked=40, begun=1, led=True, begins="step 20 of episode 1")
    assert verdict.proved
    assert str(verdict) == (
        "40 states came out again, bit for bit, from where the recording begins: "
        "step 20 of episode 1"
    )


def test_commands_that_begin_after_the_states_are_a_head(
    ride: list[Message], tmp_path: Path
) -> None:
    verdict = judged(tmp_path / "bag", changed(ride, later(20, 23)))
    assert (verdict.head, verdict.checked, verdict.unknown) == (3, 37, 0)
    assert verdict.begins == "step 23 of episode 1"
    assert verdict.proved
    assert "(3 states up to it came under commands that the bag lacks)" in str(verdict)


def test_a_recording_without_commands_or_with_one_state_proves_nothing(
    ride: list[Message], tmp_path: Path
) -> None:
    verdict = judged(tmp_path / "none", changed(ride, without(COMMANDS)))
    assert not verdict.same
    assert (verdict.checked, verdict.head) == (0, STEPS)
    assert str(verdict) == (
        "not proved: the bag holds none of the commands that led to its states to compute again"
    )
    alone = judged(tmp_path / "one", [item for item in ride if item[1] is ride[0][1]] + ride[1:3])
    assert (alone.checked, alone.begun, alone.head) == (0, 1, 0)
    assert str(alone) == "not proved: the bag holds no ride to compute again"


def test_a_state_that_is_published_again_is_not_another(
    ride: list[Message], tmp_path: Path
) -> None:
    def twice(name: str, message: Any) -> Iterator[tuple[str, Any]]:
        yield name, message
        if name == STATES:
            yield name, message

    verdict = judged(tmp_path / "bag", changed(ride, twice))
    assert (verdict.checked, verdict.begun, verdict.unknown) == (STEPS, 1, 0)
    assert verdict.proved


def test_a_command_that_was_sent_twice_is_tried_twice(ride: list[Message], tmp_path: Path) -> None:
    """A state that is published again may be answered again, otherwise; one answer led on."""

    def another_before(name: str, message: Any) -> Iterator[tuple[str, Any]]:
        if name == COMMANDS:
            other = deepcopy(message)
            other.torque += 0.5
            yield name, other
        yield name, message

    assert judged(tmp_path / "bag", changed(ride, another_before)).proved


def test_a_command_of_another_sender_did_not_lead_on(ride: list[Message], tmp_path: Path) -> None:
    forged = changed(ride, with_field(COMMANDS, 20, "controller", "somebody else"))
    verdict = judged(tmp_path / "bag", forged)
    assert (verdict.unknown, verdict.first_unknown) == (1, "step 21 of episode 1")


def episodes(*seeds: int) -> list[Message]:
    """Return rides of simulators one after the other, each from episode 1 on, as after a kill."""
    rides = [list(Rider(seed=seed).ride(20)) for seed in seeds]
    return [
        (name, message, time + number * 100 * PERIOD_NS)
        for number, ridden in enumerate(rides)
        for name, message, time in ridden
    ]


def test_episodes_are_told_apart_by_their_numbers_however_large(
    ride: list[Message], tmp_path: Path
) -> None:
    # Python keeps one object of each small number only: from 257 on, equal is not identical.
    def numbered(name: str, message: Any) -> Iterator[tuple[str, Any]]:
        message.episode += 1000
        if name == ECHOES and message.step > 0:
            message.command.episode += 1000
        yield name, message

    verdict = judged(tmp_path / "bag", changed(ride, numbered))
    assert (verdict.checked, verdict.begun) == (STEPS, 1)
    assert verdict.proved


def test_the_settings_of_an_earlier_episode_are_not_those_of_this_one(
    ride: list[Message], tmp_path: Path
) -> None:
    """They are nearer in the recording, and cannot be read."""

    def numbered(name: str, message: Any) -> Iterator[tuple[str, Any]]:
        message.episode += 1
        if name == ECHOES and message.step > 0:
            message.command.episode += 1
        yield name, message
        if name == EPISODES:
            earlier = deepcopy(message)
            earlier.episode -= 1
            earlier.physics = "{"
            yield name, earlier

    verdict = judged(tmp_path / "bag", changed(ride, numbered))
    assert (verdict.checked, verdict.begun) == (STEPS, 1)
    assert verdict.proved


def test_the_settings_of_a_simulator_that_was_started_again_with_others_hold(
    tmp_path: Path,
) -> None:
    """The same episode and steps, ridden on another bicycle before and after."""
    messages, plants = [], (ChoiPlant(), ChoiPlant.named("corrected"), ChoiPlant())
    for number, plant in enumerate(plants):
        late = 100 * number * PERIOD_NS
        ridden = held({}, lambda step: step % 2 == 0, plant)
        messages += [(name, message, time + late) for name, message, time in ridden]
    verdict = judged(tmp_path / "bag", messages)
    assert (verdict.checked, verdict.begun) == (90, 3)
    assert verdict.proved, verdict
    one, other = ([m for n, m, _ in messages if n == STATES][index] for index in (30, 61))
    assert one.step == other.step == 30
    assert one.lean_angle != other.lean_angle


def test_a_simulator_that_was_started_again_begins_again(tmp_path: Path) -> None:
    """The same episode and steps with other settings: the nearest in the recording hold."""
    verdict = judged(tmp_path / "bag", episodes(3, 4, 5))
    assert (verdict.checked, verdict.begun, verdict.begins) == (60, 3, "")
    assert verdict.proved


def test_a_simulator_that_only_stood_is_not_where_the_next_one_rode_from(tmp_path: Path) -> None:
    """Both have step 0 of episode 1, in other places."""
    messages = episodes(3, 4)
    later = next(index for index, item in enumerate(messages) if item[2] >= 100 * PERIOD_NS)
    stood = [item for item in messages[:later] if getattr(item[1], "step", 0) == 0]
    starts = [item[1] for item in [*stood, *messages[later:]] if item[0] == STATES]
    assert starts[0].step == starts[1].step == 0
    assert starts[0].rear_contact != starts[1].rear_contact
    verdict = judged(tmp_path / "bag", stood + messages[later:])
    assert (verdict.checked, verdict.begun) == (20, 2)
    assert verdict.proved, verdict


def test_another_episode_begins_again(tmp_path: Path) -> None:
    rider = Rider(seed=3)
    messages = list(rider.ride(20))
    messages += rider.ride(40)
    count = len({message.episode for name, message, _ in messages if name == STATES})
    assert count > 1
    verdict = judged(tmp_path / "bag", messages)
    assert (verdict.checked, verdict.begun, verdict.unknown) == (40, count, 0)
    assert verdict.proved


def held(
    pushes: dict[int, float], answered: Callable[[int], bool], plant: ChoiPlant | None = None
) -> Iterator[Message]:
    """Ride under commands that come at some steps only, and are held in between, with pushes."""
    simulator = Simulator(Rider().scenario, plant, seed=8)
    simulator.reset(None)
    yield (
        EPISODES,
        EpisodeInfo(
            episode=1,
            seed=int(simulator.seed),
            physics=simulator.plant.to_json(),
            scenario=simulator.scenario.to_json(),
        ),
        1,
    )
    yield STATES, convert.from_snapshot(simulator.snapshot, 0), 3
    command = None
    for step in range(30):
        now = (step + 1) * PERIOD_NS
        if answered(step):
            message = BicycleCommand(episode=1, step=step, torque=0.002 * step, controller="me")
            yield COMMANDS, message, now - 5
            command = convert.to_command(message)
        push = pushes.get(step, 0.0)
        if push:
            yield PUSHES, convert.from_push(Push(1, step, push), now), now - 4
        state = simulator.step(command, push)
        echo = convert.from_applied(simulator.applied, state.episode, state.step, now)
        yield ECHOES, echo, now - 3
        yield STATES, convert.from_snapshot(state, now), now


def test_held_commands_zero_input_and_pushes_are_proved(tmp_path: Path) -> None:
    messages = list(held({7: 0.25, 12: -0.5}, lambda step: step > 3 and step % 3 == 0))
    sources = {message.command_source for name, message, _ in messages if name == ECHOES}
    assert sources == {CommandEcho.SOURCE_FRESH, CommandEcho.SOURCE_HELD, CommandEcho.SOURCE_ZERO}
    verdict = judged(tmp_path / "bag", messages)
    assert verdict.proved, verdict
    assert (verdict.checked, verdict.head, verdict.unknown) == (30, 0, 0)
    lost = judged(tmp_path / "lost", [item for item in messages if item[0] != PUSHES])
    assert lost.difference.startswith("step 8 of episode 1: lean_")


def test_under_zero_input_no_command_was_led_by(tmp_path: Path) -> None:
    """Steps under zero input need no command, and a command that is missing later is a head."""
    messages = list(held({}, lambda step: step > 20))
    verdict = judged(tmp_path / "bag", messages)
    assert verdict.proved
    late = judged(tmp_path / "late", changed(messages, without(COMMANDS, 21, 22)))
    assert (late.head, late.unknown, late.checked) == (2, 0, 28)
    assert late.begins == "step 23 of episode 1"


def test_settings_that_are_missing_or_foreign_are_named(
    ride: list[Message], tmp_path: Path
) -> None:
    def foreign(name: str, message: Any) -> Iterator[tuple[str, Any]]:
        if name == EPISODES:
            message.scenario, message.version = '{"no": "such"}', "9.9"
        yield name, message

    with pytest.raises(
        BagError,
        match=r"episode 1 is not one of this simulator's \(.*\): verify "
        r"it with version 9\.9",
    ):
        judged(tmp_path / "foreign", changed(ride, foreign))
    other = [
        (name, EpisodeInfo(episode=2) if name == EPISODES else message, time)
        for name, message, time in ride
    ]
    words = f"the bag lacks the settings of episode 1: record {EPISODES} too"
    with pytest.raises(BagError, match=re.escape(words)):
        judged(tmp_path / "other", other)
