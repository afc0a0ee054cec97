"""Outcomes of goals in words, and which of them are new."""

from __future__ import annotations

import math

import pytest

from bicycle_cockpit.goal_words import NewsFilter, kind, level, text
from bicycle_controller.control.goals import Status

HERE, THERE = (1.0, 2.0), (30.0, -4.25)


@pytest.mark.parametrize(
    ("status", "message", "said"),
    [
        (Status.ACTIVE, "5.0 m to go", "rides to goal (30.0, -4.2): 5.0 m to go"),
        (
            Status.REACHED,
            "reached after 7.1 s and 19.5 m",
            "goal (30.0, -4.2) reached after 7.1 s and 19.5 m",
        ),
        (Status.REACHED, "", "goal (30.0, -4.2) reached"),
        (
            Status.MISSED,
            "orbits the goal at 2.0 m: send it again",
            "goal (30.0, -4.2) missed: orbits the goal at 2.0 m: send it again",
        ),
        (Status.FALLEN, "the bicycle fell", "goal (30.0, -4.2) not reached: the bicycle fell"),
    ],
)
def test_one_line_for_a_person(status: Status, message: str, said: str) -> None:
    assert text(status, THERE, message) == said


def test_a_place_that_is_none_is_not_shown_as_one() -> None:
    said = text(Status.REJECTED, (math.nan, 1.0), "x is nan")
    assert said == "goal without a place rejected: x is nan"
    assert (kind(Status.GIVEN_UP), level(Status.GIVEN_UP)) == ("given_up", "warn")


def news(*changes: tuple[Status, tuple[float, float]]) -> list[bool]:
    news_filter = NewsFilter()
    return [news_filter.is_new(status, place) for status, place in changes]


def test_a_path_that_is_sent_again_is_no_news() -> None:
    ways = (Status.ACTIVE, HERE), (Status.REPLACED, HERE), (Status.QUEUED, THERE)
    assert news(*ways, (Status.ACTIVE, HERE)) == [True, False, False, False]
    assert news(*ways, (Status.ACTIVE, THERE)) == [True, False, False, True]
    again = news((Status.ACTIVE, HERE), (Status.REACHED, HERE), (Status.ACTIVE, HERE))
    assert again == [True, True, True], "it was reached, and is ridden to once more"


def test_waypoints_that_go_with_the_goal_are_not_told_one_by_one() -> None:
    gone = (Status.CANCELLED, HERE), (Status.CANCELLED, THERE), (Status.CANCELLED, THERE)
    assert news((Status.ACTIVE, HERE), *gone) == [True, True, False, False]
    assert news((Status.REJECTED, THERE), (Status.REJECTED, THERE)) == [True, True]
