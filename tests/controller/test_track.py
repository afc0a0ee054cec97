"""The speed of another bicycle: its own word, unless its places contradict it."""

from __future__ import annotations

import math

import pytest

from bicycle_controller.control.track import Track


def heard(told: float, moves: float, clock: float = 1.0, stamped: bool = True) -> float:
    """Return the speed believed after a second of places, at the clock's rate."""
    track, heading, speed = Track(), 0.7, math.nan
    for look in range(11):
        now = 0.1 * look
        time = clock * now
        place = -math.sin(heading) * moves * time, math.cos(heading) * moves * time
        speed = track.speed(now, 5.0 + time if stamped else 0.0, place, heading, told)
        if now < 0.35:
            assert speed == told
    return speed


def test_a_told_speed_that_the_places_bear_out_is_believed() -> None:
    assert heard(3.0, 3.0) == 3.0
    assert heard(3.0, 2.5) == 3.0
    assert heard(3.0, 3.0, clock=0.25) == 3.0  # simulated time runs slower
    assert heard(3.0, 3.0, clock=8.0) == 3.0
    assert heard(3.0, 3.0, stamped=False) == 3.0
    assert heard(0.0, 0.0) == 0.0


@pytest.mark.parametrize("stamped", [True, False])
def test_the_places_are_believed_where_they_contradict(stamped: bool) -> None:
    assert heard(3.0, 0.0, stamped=stamped) == pytest.approx(0.0, abs=1e-9)
    assert heard(0.0, 3.0, stamped=stamped) == pytest.approx(3.0)
    assert heard(3.0, -3.0, stamped=stamped) == pytest.approx(-3.0)


def test_a_stamp_that_stands_still_is_a_bicycle_that_does() -> None:
    assert heard(3.0, 3.0, clock=0.0) == pytest.approx(0.0)


def test_a_place_that_is_set_anew_is_no_ride() -> None:
    track = Track()
    for look in range(6):
        track.speed(0.1 * look, 0.1 * look, (0.0, 0.3 * look), 0.0, 3.0)
    assert track.speed(0.6, 0.6, (500.0, 0.0), 0.0, 2.0) == 2.0
    assert track.speed(0.7, 0.0, (0.0, 0.0), 0.0, 2.0) == 2.0
