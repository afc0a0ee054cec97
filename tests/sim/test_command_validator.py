"""Commands that are accepted, and the reports about the others."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from busy_machine import UNHURRIED
from hypothesis import given
from hypothesis import strategies as st
from still_clock import Clock

from bicycle_common.types import Command
from bicycle_sim.runtime.command_validator import QUIET, CommandValidator, RejectionReason

LIMITS = np.array([2.0, 0.2, 0.0])
GOOD = Command(1, 0, 1.0, -0.1, 0.0, (3.0, 4.0), 1, "a", "p")


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def validator(clock: Clock) -> CommandValidator:
    validator = CommandValidator(LIMITS, release=0.25, max_age=10, clock=clock)
    validator.begin(1)
    clock.now += 1.0
    return validator


def test_an_answer_to_the_present_state_is_obeyed(validator: CommandValidator) -> None:
    assert validator.decide(GOOD, 0).accepted
    assert validator.newest is GOOD
    assert validator.owner == "a"


@pytest.mark.parametrize(
    ("change", "reason", "words"),
    [
        ({"torque": math.nan}, RejectionReason.NOT_FINITE, "torque is nan"),
        ({"pedal_force": math.inf}, RejectionReason.NOT_FINITE, "check the policy"),
        ({"goal": (math.nan, 0.0)}, RejectionReason.NOT_FINITE, "finite goals"),
        ({"displacement": 0.2001}, RejectionReason.OUT_OF_RANGE, "beyond the scenario's 0.2 m"),
        ({"pedal_force": 1e-300}, RejectionReason.OUT_OF_RANGE, "load a policy"),
        ({"episode": 2}, RejectionReason.WRONG_EPISODE, "this is episode 1"),
        ({"step": 4}, RejectionReason.FUTURE, "at step 3 only"),
        ({"step": 0}, RejectionReason.STALE, "step 1 is answered already"),
        ({"controller": "b", "step": 3}, RejectionReason.SECOND_CONTROLLER, "'a' is in charge"),
    ],
)
def test_a_bad_command_is_refused_once_aloud(
    validator: CommandValidator, change: dict[str, Any], reason: RejectionReason, words: str
) -> None:
    good = replace(GOOD, step=1)
    assert validator.decide(good, 1).accepted
    bad = replace(GOOD, **{"step": 2, **change})
    first, second = validator.decide(bad, 3), validator.decide(bad, 3)
    assert first.reason is second.reason is reason
    assert words in first.warning
    assert "\n" not in first.warning
    assert second.warning == ""
    assert validator.rejected[reason] == 2
    assert validator.newest is good, "a refused command changes nothing"


def test_the_same_trouble_is_told_again_after_a_quiet_time(
    validator: CommandValidator, clock: Clock
) -> None:
    bad = replace(GOOD, torque=math.nan)
    warned = []
    for pause in (0.0, QUIET - 1, QUIET - 1, QUIET + 1):
        clock.now += pause
        warned.append(bool(validator.decide(bad, 0).warning))
    assert warned == [True, False, False, True]


def test_a_repeated_answer_keeps_its_sender_alive(
    validator: CommandValidator, clock: Clock
) -> None:
    assert validator.decide(GOOD, 0).accepted
    clock.now += 0.2
    decision = validator.decide(GOOD, 0)
    assert decision.reason is RejectionReason.DUPLICATE
    assert decision.warning == ""
    clock.now += 0.2
    assert validator.owner == "a"


def test_another_controller_takes_over_after_silence_only(
    validator: CommandValidator, clock: Clock
) -> None:
    other = replace(GOOD, controller="b", step=1)
    assert validator.decide(GOOD, 0).accepted
    clock.now += 0.24
    assert validator.decide(other, 1).reason is RejectionReason.SECOND_CONTROLLER
    clock.now += 0.02
    assert validator.decide(other, 1).accepted
    assert validator.decide(replace(GOOD, step=2), 2).reason is RejectionReason.SECOND_CONTROLLER


def test_rubbish_does_not_keep_its_sender_in_charge(
    validator: CommandValidator, clock: Clock
) -> None:
    assert validator.decide(GOOD, 0).accepted
    for step in range(1, 5):
        clock.now += 0.1
        assert not validator.decide(replace(GOOD, step=step, torque=math.nan), step).accepted
    assert validator.owner is None


def test_an_answer_from_long_ago_is_stale_though_nothing_newer_came(
    validator: CommandValidator,
) -> None:
    assert validator.decide(replace(GOOD, step=5), 15).accepted
    decision = validator.decide(replace(GOOD, step=6), 17)
    assert decision.reason is RejectionReason.STALE
    assert "faster controller" in decision.warning


def test_answers_in_flight_at_a_reset_are_no_trouble(
    validator: CommandValidator, clock: Clock
) -> None:
    assert validator.decide(GOOD, 0).accepted
    validator.begin(2)
    assert validator.newest is None
    clock.now += 0.1
    late = validator.decide(replace(GOOD, step=1), 0)
    assert (late.reason, late.warning) == (RejectionReason.WRONG_EPISODE, "")
    clock.now += QUIET + 1
    assert validator.decide(replace(GOOD, step=1), 0).warning


@pytest.mark.parametrize(("pause", "told"), [(1.0, False), (1.01, True)])
def test_an_answer_to_an_old_episode_is_told_after_just_a_second(
    validator: CommandValidator, clock: Clock, pause: float, told: bool
) -> None:
    validator.begin(2)
    clock.now += pause
    assert bool(validator.decide(replace(GOOD, step=1), 0).warning) == told


@UNHURRIED
@given(
    st.tuples(*[st.floats(allow_nan=True, allow_infinity=True)] * 3),
    st.integers(0, 2**32 - 1),
    st.integers(0, 2**64 - 1),
    st.text(max_size=20),
)
def test_whatever_is_obeyed_is_finite_in_range_and_of_the_present(
    action: tuple[float, float, float], episode: int, step: int, controller: str
) -> None:
    validator = CommandValidator(LIMITS, clock=Clock())
    validator.begin(1)
    decision = validator.decide(Command(episode, step, *action, controller=controller), 3)
    sound = bool(np.isfinite(action).all() and (np.abs(action) <= LIMITS).all())
    assert decision.accepted == (sound and episode == 1 and step <= 3)


def test_a_gate_without_settings_lets_another_in_after_a_quarter_second_and_ten_steps() -> None:
    clock = Clock()
    validator = CommandValidator(LIMITS, clock=clock)
    first = replace(GOOD, episode=0, step=0)
    assert validator.decide(first, 10).accepted, "episodes are counted from 0"
    clock.now += 0.25
    other = replace(first, controller="b", step=1)
    assert validator.decide(other, 1).reason is RejectionReason.SECOND_CONTROLLER
    clock.now += 0.125
    assert validator.decide(other, 12).reason is RejectionReason.STALE
    assert validator.decide(other, 11).accepted


def test_a_repeated_answer_is_known_late_in_a_ride(validator: CommandValidator) -> None:
    # Python keeps one object of each small number only: from 257 on, equal is not identical.
    assert validator.decide(replace(GOOD, step=int("100000")), 100_000).accepted
    decision = validator.decide(replace(GOOD, step=int("100000")), 100_000)
    assert decision.reason is RejectionReason.DUPLICATE


def test_the_same_trouble_is_told_again_after_just_five_seconds(
    validator: CommandValidator, clock: Clock
) -> None:
    bad = replace(GOOD, torque=math.nan)
    assert validator.decide(bad, 0).warning
    clock.now += 4.75
    assert not validator.decide(bad, 0).warning
    clock.now += 5.0
    assert validator.decide(bad, 0).warning


def test_silence_and_accepted_commands_are_counted(clock: Clock) -> None:
    clock.now = 1.0
    validator = CommandValidator(LIMITS, clock=clock)
    validator.begin(1)
    assert validator.accepted == 0
    for step in range(3):
        assert validator.decide(replace(GOOD, step=step), step).accepted
        assert validator.accepted == step + 1
    clock.now = 5.5
    assert validator.silence() == 4.5
    assert not validator.decide(replace(GOOD, step=1), 3).accepted
    assert validator.accepted == 3
