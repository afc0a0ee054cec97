"""However many events come, and whatever they tell, a page gets no more than it can take."""

from __future__ import annotations

from bicycle_cockpit.broadcaster import MOST_RELIABLE
from bicycle_cockpit.event_room import BURST, RATE, EventRoom
from bicycle_controller.control.goals import Status

SECONDS = 180


def test_a_flood_is_cut_however_long_it_lasts_and_hides_nothing_else() -> None:
    now = 0.0
    room = EventRoom(lambda: now)
    taken = counted = lines = 0
    for number in range(20 * SECONDS):
        now = number / 20
        taken += room.take("rejected")
        left_out = room.left_out()
        counted += left_out
        lines += left_out > 0
    assert taken <= BURST + RATE * SECONDS
    assert taken + lines < 500
    assert room.take("fell")
    assert taken + counted <= 20 * SECONDS
    now += 60.0
    assert taken + counted + room.left_out() == 20 * SECONDS, "each is told or counted"
    assert room.take("rejected")


def test_floods_of_every_kind_at_once_have_room_in_a_pages_outbox() -> None:
    room = EventRoom(lambda: 0.0)
    kinds = [status.name for status in Status]
    taken = sum(room.take(kind) for _ in range(1500) for kind in kinds)
    assert BURST < taken < MOST_RELIABLE
