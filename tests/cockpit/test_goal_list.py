"""Goals ahead, also when messages of the controller are lost on the way."""

from __future__ import annotations

import math

from bicycle_cockpit.goal_list import GoalList
from bicycle_controller.control.goals import Status

A, B, C = (1.0, 0.0), (2.0, 0.0), (3.0, 0.0)


def test_a_path_is_ridden_down() -> None:
    book = GoalList()
    book.sent([A, B, C])
    book.changed(Status.ACTIVE, A, 2)
    assert (book.active, book.ahead) == (A, [B, C])
    book.changed(Status.REACHED, A, 2)
    assert (book.active, book.ahead) == (None, [B, C])
    book.changed(Status.ACTIVE, B, 1)
    assert (book.active, book.ahead) == (B, [C])
    book.changed(Status.REACHED, B, 1)
    book.changed(Status.ACTIVE, C, 0)
    book.changed(Status.REACHED, C, 0)
    assert (book.active, book.ahead) == (None, [])


def test_the_heading_is_that_of_the_active_goal_alone() -> None:
    book = GoalList()
    headings = []
    book.sent([A, B])
    book.headed(A, None)
    book.changed(Status.ACTIVE, A, 1)
    headings.append(book.heading)
    book.headed(B, 0.5)
    headings.append(book.heading)
    book.changed(Status.ACTIVE, B, 0)
    headings.append(book.heading)
    book.changed(Status.REACHED, B, 0)
    headings.append(book.heading)
    assert headings == [None, None, 0.5, None]


def test_what_was_lost_does_not_matter() -> None:
    book = GoalList()
    book.sent([A, B, C])
    book.changed(Status.ACTIVE, C, 0)
    assert (book.active, book.ahead) == (C, [])


def test_a_newer_goal_takes_the_place() -> None:
    book = GoalList()
    book.sent([A, B])
    book.changed(Status.ACTIVE, A, 1)
    book.sent([C])
    book.changed(Status.REPLACED, A, 0)
    assert book.active == A, "until the controller says that it rides elsewhere"
    book.changed(Status.ACTIVE, C, 0)
    assert (book.active, book.ahead) == (C, [])


def test_a_fall_and_an_empty_path_leave_none() -> None:
    for end in (Status.FALLEN, Status.CANCELLED):
        book = GoalList()
        book.sent([A, B])
        book.changed(Status.ACTIVE, A, 1)
        book.changed(end, A, 0)
        assert (book.active, book.ahead) == (None, [])
    book.sent([])
    assert book.with_more([C]) == [C]


def test_waypoints_come_after_all_that_lies_ahead() -> None:
    book = GoalList()
    book.sent([A, B])
    book.changed(Status.ACTIVE, A, 1)
    assert book.with_more([C]) == [A, B, C]


def test_a_waypoint_follows_what_was_sent_and_not_taken_yet() -> None:
    book = GoalList()
    book.sent([A])
    assert book.with_more([C]) == [A, C], "the controller is busy"
    book.changed(Status.ACTIVE, A, 0)
    book.send([B])
    book.changed(Status.REACHED, A, 0)
    assert book.with_more([C]) == [B, C]
    book.changed(Status.ACTIVE, B, 0)
    book.sent([B])
    book.changed(Status.REACHED, B, 0)
    assert book.with_more([C]) == [C], "its own path came back from the topic, and late"
    book.send([B])
    assert book.with_more([C]) == [B, C], "the same goal once more"
    book.changed(Status.REJECTED, B, 0)
    assert book.with_more([C]) == [C]
    book.send([A])
    book.send([])
    assert book.with_more([C]) == [C]


def test_a_path_that_was_refused_leaves_the_one_before() -> None:
    book = GoalList()
    book.sent([A, B])
    book.changed(Status.ACTIVE, A, 1)
    nowhere = (math.nan, 0.0)
    book.sent([nowhere])
    book.changed(Status.REJECTED, nowhere, 0)
    assert book.with_more([C]) == [A, B, C]
    book.changed(Status.ACTIVE, B, 0)
    assert (book.active, book.ahead) == (B, [])


def test_who_comes_late_knows_the_goal_but_not_the_path() -> None:
    book = GoalList()
    book.changed(Status.ACTIVE, B, 3)
    assert (book.active, book.ahead) == (B, [])
