"""The schedule, on a clock that the test turns."""

from __future__ import annotations

import math

import pytest
from still_clock import NanosecondClock

from bicycle_sim.runtime.pacing import Pacer

MS = 1_000_000


@pytest.fixture
def clock() -> NanosecondClock:
    return NanosecondClock()


def test_an_hour_of_jitter_drifts_by_nothing(clock: NanosecondClock) -> None:
    pacer = Pacer(0.025, clock=clock)
    begun = clock.now
    pacer.start()
    for step in range(1, 3600 * 40 + 1):
        clock.now += round(pacer.remaining() * 1e9) + (step * 7919 % 12) * MS
        pacer.tick()
    assert clock.now - begun == pytest.approx(3600e9, abs=12 * MS)
    assert (pacer.late, pacer.dropped) == (0, 0)


def test_the_real_time_factor_shortens_the_period(clock: NanosecondClock) -> None:
    assert Pacer(0.025, 4.0, clock).period_ns == 6_250_000


def test_a_step_later_than_half_a_period_is_late(clock: NanosecondClock) -> None:
    pacer = Pacer(0.025, clock=clock)
    pacer.start()
    clock.now += 25 * MS + 12 * MS
    first = pacer.tick()
    assert pacer.late == 0
    assert math.isnan(first.period)
    assert first.lateness == pytest.approx(0.012)
    clock.now += 13 * MS + 13 * MS
    second = pacer.tick()
    assert (pacer.late, pacer.dropped) == (1, 0)
    assert second.period == pytest.approx(0.026)
    assert pacer.remaining() == pytest.approx(0.012)


def test_missed_periods_are_dropped_and_never_made_up_for(clock: NanosecondClock) -> None:
    pacer = Pacer(0.025, clock=clock)
    pacer.start()
    clock.now += 25 * MS + 110 * MS
    tick = pacer.tick()
    assert tick.lateness == pytest.approx(0.110)
    assert (pacer.late, pacer.dropped) == (1, 4)
    assert pacer.remaining() == pytest.approx(0.015), "the next multiple, not a burst"


def test_started_again_it_forgets_the_time_between(clock: NanosecondClock) -> None:
    pacer = Pacer(0.025, clock=clock)
    pacer.start()
    clock.now += 25 * MS
    pacer.tick()
    clock.now += 3_600_000 * MS
    pacer.start()
    clock.now += 25 * MS
    assert pacer.tick().lateness == 0.0
    assert pacer.dropped == 0


@pytest.mark.parametrize("factor", [0.0, -1.0, math.nan, math.inf])
def test_a_factor_that_is_no_speed_is_refused(clock: NanosecondClock, factor: float) -> None:
    with pytest.raises(ValueError, match="real_time_factor must be"):
        Pacer(0.025, factor, clock)
