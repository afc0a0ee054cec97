"""A list of what becomes known bit by bit is shown when nothing more comes."""

from __future__ import annotations

from still_clock import Clock

from bicycle_tools.settled import Settled


def test_each_change_begins_the_wait_anew() -> None:
    clock, seen = Clock(), ["/a"]
    settled = Settled(lambda: list(seen), 1.0, clock)
    clock.now += 0.9
    seen.append("/b")
    assert not settled()
    clock.now += 0.9
    assert not settled()
    clock.now += 0.1
    assert settled()
