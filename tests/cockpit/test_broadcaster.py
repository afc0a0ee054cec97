"""Queues: bounded, oldest frames first to go, letters never lost in silence."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import pytest

from bicycle_cockpit.broadcaster import (
    MOST_CLIENTS,
    MOST_FRAMES,
    MOST_RELIABLE,
    Broadcaster,
    Outbox,
    TooSlowError,
)
from bicycle_cockpit.rows import Rows


def row(number: int, ride: int = 0) -> Rows:
    return Rows(ride, number, (f"[{number}]",))


async def emptied(box: Outbox) -> list[str]:
    taken = []
    while True:
        try:
            taken.append(await asyncio.wait_for(box.take(), 0.01))
        except asyncio.TimeoutError:
            return taken


def numbers(message: str) -> list[int]:
    """Return the rows of a frame or a piece of the history."""
    data: dict[str, Any] = json.loads(message)
    found = [row[0] for row in data["rows"]]
    assert found == list(range(data["first"], data["first"] + len(found)))
    return found


def greeted() -> Outbox:
    box = Outbox()
    box.greet("hello", [])
    return box


def test_a_slow_page_gets_what_waits_in_one_go() -> None:
    async def story() -> None:
        box = greeted()
        box.reliable("first")
        for number in range(100):
            box.stream(row(number))
            box.latest("status", f"status {number}")
        box.reliable("second")
        *before, frame = await emptied(box)
        assert before == ["hello", "first", "second", "status 99"]
        assert numbers(frame) == list(range(100))
        assert box.dropped == 0

    asyncio.run(story())


def test_a_page_that_is_far_behind_loses_the_oldest_frames_and_nothing_else() -> None:
    async def story() -> None:
        box = greeted()
        for number in range(MOST_FRAMES + 30):
            box.stream(row(number))
        _, frame = await emptied(box)
        assert numbers(frame) == list(range(30, MOST_FRAMES + 30))
        assert box.dropped == 30

    asyncio.run(story())


def test_a_page_that_keeps_up_gets_everything_in_order() -> None:
    async def story() -> None:
        box, got = greeted(), []
        assert await box.take() == "hello"
        for number in range(50):
            box.stream(row(number))
            got += numbers(await box.take())
        assert got == list(range(50))
        assert box.dropped == 0

    asyncio.run(story())


def test_a_page_gets_nothing_before_its_greeting_and_old_rows_last() -> None:
    async def story() -> None:
        box = Outbox()
        box.reliable("event")
        box.latest("status", "status")
        box.stream(row(7))  # is in the history that follows
        assert await emptied(box) == []
        box.greet("hello", [Rows(0, 4, ("[4]", "[5]", "[6]", "[7]")), Rows(0, 2, ("[2]", "[3]"))])
        box.stream(row(8))
        *first, frame, newer, older = await emptied(box)
        assert first == ["hello", "event", "status"]
        assert numbers(frame) == [8]
        assert [numbers(newer), numbers(older)] == [[4, 5, 6, 7], [2, 3]]

    asyncio.run(story())


def test_a_simulator_that_was_started_anew_ends_what_waits_of_the_old_one() -> None:
    async def story() -> None:
        box = Outbox()
        box.greet("hello", [Rows(0, 2, ("[2]", "[3]"))])
        box.stream(row(4))
        box.stream(row(0, ride=1))
        _, frame = await emptied(box)
        assert json.loads(frame) == {"type": "frame", "ride": 1, "first": 0, "rows": [[0]]}

    asyncio.run(story())


def test_another_bicycle_ends_what_waits_of_the_one_before() -> None:
    async def story() -> None:
        hub = Broadcaster()
        (one, box), (_, unread) = hub.join() or (0, Outbox()), hub.join() or (0, Outbox())
        hub.greet(one, "hello", [Rows(0, 2, ("[2]", "[3]"))])
        for kind in ("facts", "palette"):
            hub.latest(kind, f"old {kind}")
        hub.stream(row(4))
        hub.reliable("answer")
        hub.begin_anew("hello again", [Rows(0, 7, ("[7]",))])
        hub.stream(row(8))
        *first, frame, older = await emptied(box)
        assert first == ["hello", "answer", "hello again", "old palette"]
        assert numbers(frame) + numbers(older) == [8, 7]
        assert await emptied(unread) == [], "it waits for its own greeting"
        later = hub.join()
        assert later is not None
        hub.greet(later[0], "hello", [])
        assert await emptied(later[1]) == ["hello", "old palette"]

    asyncio.run(story())


def test_a_page_that_takes_nothing_is_given_up() -> None:
    async def story() -> None:
        box = Outbox()
        for _ in range(MOST_RELIABLE + 1):
            box.reliable("event")
        with pytest.raises(TooSlowError):
            await box.take()

    asyncio.run(story())


def test_one_slow_page_takes_nothing_from_another() -> None:
    async def story() -> None:
        hub = Broadcaster()
        (one, slow), (two, fast) = hub.join() or (0, Outbox()), hub.join() or (0, Outbox())
        for number in (one, two):
            hub.greet(number, "hello", [])
        got: list[int] = []
        assert await emptied(fast) == ["hello"]
        for number in range(MOST_FRAMES + 10):
            hub.stream(row(number))
            got += numbers(await fast.take())
        assert got == list(range(MOST_FRAMES + 10))
        assert slow.dropped == 10
        assert (await emptied(slow))[0] == "hello"

    asyncio.run(story())


def test_who_comes_late_gets_what_is_newest_but_no_old_frames() -> None:
    async def story() -> None:
        hub = Broadcaster()
        hub.stream(row(1))
        hub.latest("status", "old status")
        hub.latest("status", "status")
        joined = hub.join()
        assert joined is not None
        number, box = joined
        hub.reliable("for all")
        hub.reliable("for another", number + 1)
        hub.greet(number, "hello", [])
        assert await emptied(box) == ["hello", "for all", "status"]

    asyncio.run(story())


def test_there_is_room_for_so_many_and_again_when_one_leaves() -> None:
    hub = Broadcaster()
    numbers_given = [joined[0] for joined in (hub.join() for _ in range(MOST_CLIENTS)) if joined]
    assert hub.join() is None
    hub.leave(numbers_given[0])
    assert hub.join() is not None
    assert len(numbers_given) == MOST_CLIENTS
