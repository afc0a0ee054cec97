"""Pushes from the side: let in within bounds, acting once, and told apart from the state."""

from __future__ import annotations

import math
import struct

import pytest

from bicycle_common.types import Command, InitialPose
from bicycle_sim.runtime.loop import Loop, LoopOptions
from bicycle_sim.runtime.push import LARGEST_PUSH, PushGate
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named

SCENARIO = named("random-start-random-goal")
START = InitialPose(0.0, 0.0, 0.0, 2.5)


def riding() -> Loop:
    loop = Loop(Simulator(SCENARIO), LoopOptions(pace="lockstep"))
    loop.reset(START, None)
    return loop


def answer(loop: Loop) -> Command:
    state = loop.snapshot
    return Command(state.episode, state.step, 0.0, 0.0, 0.0, controller="me")


def test_a_push_adds_to_the_lean_rate_of_the_state_the_step_begins_with() -> None:
    pushed, untouched = Simulator(SCENARIO), Simulator(SCENARIO)
    for simulator in (pushed, untouched):
        simulator.reset(START)
    after, without = pushed.step(None, 0.4), untouched.step(None)
    # Upright and straight on nothing else moves the lean: omega dot = 0.4, omega = 0.4 dt.
    assert after.lean_rate == pytest.approx(0.4)
    assert after.lean_angle == pytest.approx(0.4 * 0.025)
    assert without.lean_rate == 0.0


def test_no_push_changes_no_bit() -> None:
    one, other = Simulator(SCENARIO), Simulator(SCENARIO)
    for simulator in (one, other):
        simulator.reset(START)
    turn = Command(1, 0, -0.3, 0.01, 0.0, controller="me")
    first, second = one.step(turn), other.step(turn, 0.0)
    assert struct.pack("<d", first.lean_rate) == struct.pack("<d", second.lean_rate)
    assert first == second


def test_it_acts_in_the_next_step_and_once() -> None:
    loop = riding()
    loop.push(0.2)
    loop.push(0.1)
    result = loop.receive(answer(loop))[1]
    assert result is not None
    assert result.push is not None
    assert (result.push.episode, result.push.step) == (1, 0)
    assert result.push.lean_rate == pytest.approx(0.3)
    assert result.snapshot.lean_rate == pytest.approx(0.3)
    following = loop.receive(answer(loop))[1]
    assert following is not None
    assert following.push is None


def test_the_other_side_mirrors() -> None:
    left, right = Simulator(SCENARIO), Simulator(SCENARIO)
    for simulator, push in ((left, 0.5), (right, -0.5)):
        simulator.reset(START)
        simulator.step(None, push)
        for _ in range(10):
            simulator.step(None)
    assert left.snapshot.lean_angle == -right.snapshot.lean_angle


def test_a_reset_forgets_it() -> None:
    loop = riding()
    loop.push(0.2)
    loop.reset(START, None)
    result = loop.receive(answer(loop))[1]
    assert result is not None
    assert result.push is None


@pytest.mark.parametrize("bad", [math.nan, math.inf, LARGEST_PUSH * 1.01, -LARGEST_PUSH * 1.01])
def test_what_is_beyond_reason_is_refused(bad: float) -> None:
    with pytest.raises(ValueError, match=r"(finite number|push less)$"):
        PushGate().add(bad)


def test_pushes_of_one_step_are_bounded_together() -> None:
    gate = PushGate()
    gate.add(0.75 * LARGEST_PUSH)
    said = r"1.5 rad/s \(3 rad/s with those that wait for the same step\) is beyond 2 rad/s"
    with pytest.raises(ValueError, match=said):
        gate.add(0.75 * LARGEST_PUSH)
    assert gate.take() == 0.75 * LARGEST_PUSH
    assert gate.take() == 0.0


def test_a_fallen_bicycle_is_not_pushed() -> None:
    loop = riding()
    loop.push(LARGEST_PUSH)
    while not loop.snapshot.fallen:
        loop.receive(answer(loop))
    with pytest.raises(ValueError, match="reset first"):
        loop.push(0.1)
