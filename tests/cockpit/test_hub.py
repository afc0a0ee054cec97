"""Queues: bounded, oldest frames first to go, letters never lost in silence."""

from __future__ import annotations

import asyncio

import pytest

from bicycle_cockpit.hub import MOST_CLIENTS, MOST_FRAMES, MOST_LETTERS, Hub, Outbox, TooSlowError


async def emptied(box: Outbox) -> list[str]:
    taken = []
    while True:
        try:
            taken.append(await asyncio.wait_for(box.take(), 0.01))
        except asyncio.TimeoutError:
            return taken


def test_a_slow_page_loses_the_oldest_frames_and_nothing_else() -> None:
    async def story() -> None:
        box = Outbox()
        box.letter("first")
        for number in range(100):
            box.frame(f"frame {number}")
            box.newest("status", f"status {number}")
        box.letter("second")
        kept = [f"frame {number}" for number in range(100 - MOST_FRAMES, 100)]
        assert await emptied(box) == ["first", "second", "status 99", *kept]
        assert box.dropped == 100 - MOST_FRAMES

    asyncio.run(story())


def test_a_page_that_keeps_up_gets_everything_in_order() -> None:
    async def story() -> None:
        box, got = Outbox(), []
        box.letter("hello")
        assert await box.take() == "hello"
        for number in range(50):
            box.frame(str(number))
            got.append(await box.take())
        assert got == [str(number) for number in range(50)]
        assert box.dropped == 0

    asyncio.run(story())


def test_a_page_is_greeted_before_it_gets_frames() -> None:
    async def story() -> None:
        box = Outbox()
        box.letter("event for all", own=False)
        box.frame("what the greeting will hold")
        box.letter("hello")
        box.frame("new")
        assert await emptied(box) == ["event for all", "hello", "new"]
        assert box.dropped == 0

    asyncio.run(story())


def test_a_page_that_takes_nothing_is_given_up() -> None:
    async def story() -> None:
        box = Outbox()
        for _ in range(MOST_LETTERS + 1):
            box.letter("event")
        with pytest.raises(TooSlowError):
            await box.take()

    asyncio.run(story())


def test_one_slow_page_takes_nothing_from_another() -> None:
    async def story() -> None:
        hub = Hub()
        (one, slow), (two, fast) = hub.join() or (0, Outbox()), hub.join() or (0, Outbox())
        for number in (one, two):
            hub.letter("hello", number)
        got: list[str] = []
        assert await emptied(fast) == ["hello"]
        for number in range(40):
            hub.frame(str(number))
            got += await emptied(fast)
        assert got == [str(number) for number in range(40)]
        assert slow.dropped == 40 - MOST_FRAMES
        assert (await emptied(slow))[0] == "hello"

    asyncio.run(story())


def test_who_comes_late_gets_what_is_newest_but_no_old_frames() -> None:
    async def story() -> None:
        hub = Hub()
        hub.frame("old")
        hub.newest("status", "old status")
        hub.newest("status", "status")
        joined = hub.join()
        assert joined is not None
        number, box = joined
        hub.letter("for all")
        hub.letter("for another", number + 1)
        assert await emptied(box) == ["for all", "status"]

    asyncio.run(story())


def test_there_is_room_for_so_many_and_again_when_one_leaves() -> None:
    hub = Hub()
    numbers = [joined[0] for joined in (hub.join() for _ in range(MOST_CLIENTS)) if joined]
    assert hub.join() is None
    hub.leave(numbers[0])
    assert hub.join() is not None
    assert len(numbers) == MOST_CLIENTS
