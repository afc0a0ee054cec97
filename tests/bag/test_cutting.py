"""Times of sending on the clock of the recorder's host."""

from __future__ import annotations

import time

import pytest

from bicycle_bag.cutting import FEWEST, MOST, SECOND_NS, Cut, SetBack, SourceClock

MS = 1_000_000
HOUR = 3600 * SECOND_NS


def heard(clock: SourceClock, second: int, skew: int, *ways: int) -> None:
    """Messages within a second that took so long, of a clock that is behind by `skew`."""
    for number, way in enumerate(ways):
        sent = second * SECOND_NS + number * 25 * MS
        clock.add(sent + way + skew, sent, sent)


def test_on_one_host_a_time_is_what_it_is_however_late_messages_come() -> None:
    clock = SourceClock()
    assert clock.here(5) == 5
    for second in range(MOST + FEWEST):
        heard(clock, second, 0, 40 * MS, 3000 * MS, 45 * MS, 800 * MS)
        assert clock.here(7) == 7


@pytest.mark.parametrize("skew", [-HOUR, -80 * MS, 80 * MS, HOUR])
def test_a_clock_that_is_ahead_or_behind_is_set_right(skew: int) -> None:
    clock = SourceClock()
    for second in range(FEWEST):
        assert clock.here(10 * MS) == 10 * MS
        heard(clock, second, skew, 30 * MS, 2 * MS, 700 * MS)
    assert clock.here(10 * MS) == 10 * MS + skew + 2 * MS


@pytest.mark.parametrize("jump", [-HOUR, HOUR])
def test_a_message_on_its_way_while_the_clock_was_set_misleads_nobody(jump: int) -> None:
    clock = SourceClock()
    for second in range(2 * FEWEST):
        heard(clock, second, jump if second == FEWEST else 0, MS)
    assert clock.here(8) == 8


def test_what_was_kept_for_latecomers_misleads_nobody() -> None:
    clock = SourceClock()
    heard(clock, 0, 0, 500 * SECOND_NS, 400 * SECOND_NS)
    for second in range(1, FEWEST):
        assert clock.here(9) == 9
        heard(clock, second, 0, MS)
    assert clock.here(9) == 9


def test_a_machine_that_slept_misleads_nobody() -> None:
    clock = SourceClock()
    for second in range(FEWEST):
        heard(clock, second, 0, MS)
    heard(clock, 65, 0, *(way * SECOND_NS for way in range(60, 1, -1)))
    assert clock.here(9) == 9


def test_another_clock_is_believed_after_a_while() -> None:
    clock = SourceClock()
    for second in range(MOST):
        heard(clock, second, -HOUR, MS)
    for second in range(MOST, 2 * MOST):
        heard(clock, second, 0, MS)
    assert clock.here(8) == 8


@pytest.mark.parametrize(
    ("late", "set_back", "left_out"),
    [
        (-HOUR, 0, False),
        (0, 0, False),
        (1, 0, True),
        (HOUR, 0, True),
        (1, HOUR, True),
        (5 * SECOND_NS, HOUR, True),
        (6 * SECOND_NS, HOUR, False),
        (HOUR, HOUR, False),
        (HOUR + 1, HOUR, True),
        (4 * SECOND_NS, 4 * SECOND_NS, True),
    ],
)
def test_what_was_sent_before_the_clock_was_set_back_was_sent_before_the_end(
    late: int, set_back: int, left_out: bool
) -> None:
    assert Cut(10 * HOUR, set_back).is_before(10 * HOUR + late) == left_out


def test_a_clock_that_is_set_back_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    wall, steady = [10 * HOUR], [0]
    monkeypatch.setattr(time, "time_ns", lambda: wall[0])
    monkeypatch.setattr(time, "monotonic_ns", lambda: steady[0])
    seen = SetBack()
    for passed, jump, found in (
        (7, 0, 0),
        (5, -HOUR, HOUR),
        (9, HOUR // 2, HOUR // 2),
        (1, HOUR, 0),
    ):
        steady[0] += passed
        wall[0] += passed + jump
        assert seen.look() == found
