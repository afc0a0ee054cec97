"""The clock of a replay: held, stepped and run at another speed."""

from __future__ import annotations

import pytest

from bicycle_bag.tempo import FASTEST, SLICE, Tempo


class Time:
    """A steady clock that goes on when somebody sleeps."""

    def __init__(self) -> None:
        self.now = 100.0
        self.sleeps = 0
        self.acts: dict[int, object] = {}

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> bool:
        self.now += seconds
        self.sleeps += 1
        act = self.acts.get(self.sleeps)
        return act() is END if callable(act) else False


END = object()
"""Result of an act that ends the wait."""


def end() -> object:
    return END


def test_what_is_due_is_waited_for() -> None:
    time = Time()
    tempo = Tempo(clock=time)
    assert tempo.wait_until(1.0, time.sleep)
    assert time.now == pytest.approx(101.0)
    assert tempo.wait_until(0.5, time.sleep), "what is late comes at once"
    assert time.now == pytest.approx(101.0)


def test_time_that_is_held_does_not_pass() -> None:
    time = Time()
    tempo = Tempo(clock=time)
    time.acts = {5: tempo.pause, 50: tempo.resume}
    assert tempo.wait_until(1.0, time.sleep)
    assert time.now == pytest.approx(101.0 + 45 * SLICE)
    assert tempo.position == pytest.approx(1.0)


def test_a_step_lets_one_message_pass() -> None:
    time = Time()
    tempo = Tempo(paused=True, clock=time)
    time.acts = {3: tempo.step, 8: end}
    assert tempo.wait_until(7.0, time.sleep)
    assert tempo.position == 7.0
    assert not tempo.wait_until(8.0, time.sleep), "the second one is not let pass"
    tempo.resume()
    assert not tempo.step(), "only a clock that is held is stepped"
    assert tempo.wait_until(8.0, time.sleep)
    assert tempo.position == pytest.approx(8.0)


def test_another_speed_begins_where_it_is() -> None:
    time = Time()
    tempo = Tempo(clock=time)
    tempo.wait_until(1.0, time.sleep)
    assert tempo.speed_up(4.0) == 4.0
    tempo.wait_until(5.0, time.sleep)
    assert time.now == pytest.approx(102.0)
    assert tempo.speed_up(1e9) == FASTEST


def test_the_end_is_not_waited_for() -> None:
    time = Time()
    time.acts = {2: end}
    assert not Tempo(clock=time).wait_until(1000.0, time.sleep)
    assert time.sleeps == 2
    tempo = Tempo(paused=True, clock=time)
    time.acts = {4: end}
    assert not tempo.wait_until(0.0, time.sleep), "held from the beginning"
