"""One publisher's messages from several subscriptions: order, repetitions, losses."""

from __future__ import annotations

import random

import pytest

from bicycle_bag import stream
from bicycle_bag.stream import Numbering, Stream


def taken(heard: Stream[str], *numbers: int, own: bool = True) -> list[str]:
    return [text for number in numbers for text in heard.take(number, f"{number}", own)]


def test_each_number_is_new_once_and_the_others_are_missing() -> None:
    """In any order of arrival, against sets."""
    draw = random.Random(1)
    for _ in range(200):
        numbers = [draw.randint(1, 30) for _ in range(draw.randint(1, 40))]
        numbering, seen = Numbering(), set[int]()
        for number in numbers:
            assert numbering.take(number) == (number not in seen)
            seen.add(number)
            assert numbering.last == max(seen)
            assert numbering.missing == max(seen) - min(seen) + 1 - len(seen)


def test_only_the_latest_gaps_can_still_be_filled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "MOST_GAPS", 2)
    numbering = Numbering()
    for number in (1, 3, 5, 7):
        assert numbering.take(number)
    assert [numbering.take(number) for number in (2, 4, 6)] == [False, True, True]
    assert numbering.missing == 1


def test_what_a_subscription_ahead_has_received_waits_for_earlier_messages() -> None:
    heard: Stream[str] = Stream()
    assert taken(heard, 1, 2) == ["1", "2"]
    assert taken(heard, 2, 9, 10, own=False) == []
    assert taken(heard, 3, 4, 5) == ["3", "4", "5"]
    assert taken(heard, *range(6, 12)) == [f"{number}" for number in range(6, 12)]
    assert (heard.rest(), heard.lost) == ([], 0)


def test_a_subscription_ahead_fills_the_gaps_of_the_publishers_own() -> None:
    heard: Stream[str] = Stream()
    assert taken(heard, 1) == ["1"]
    assert taken(heard, 4, 3, 8, own=False) == []
    assert taken(heard, 6) == ["3", "4", "6"]
    assert heard.lost == 2
    assert taken(heard, 5, own=False) == ["5"]
    assert taken(heard, 5, 6, own=False) == []
    assert heard.lost == 1
    assert heard.rest() == ["8"]
    assert heard.lost == 2


def test_not_too_many_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "MOST_AHEAD", 2)
    heard: Stream[str] = Stream()
    assert taken(heard, 1) == ["1"]
    assert taken(heard, 5, 6, own=False) == []
    assert taken(heard, 7, own=False) == ["5"]
    assert taken(heard, 2, 3, 4, 5) == ["2", "3", "4"]
    assert (heard.rest(), heard.lost) == (["6", "7"], 0)
