"""Outcome of each goal, also when controllers die and goals are sent again."""

from __future__ import annotations

import math

from rides import statuses

from bicycle_controller.control.goals import Status
from bicycle_tools.outcomes import outcomes
from bicycle_tools.plan import Plan

A, B, C = (10.0, 0.0), (20.0, 0.0), (30.0, 5.0)
QUEUED, ACTIVE, REACHED, MISSED, GIVEN_UP, REPLACED, FALLEN, REJECTED, CANCELLED = range(9)


def test_waiting_goals_are_put_in_their_order() -> None:
    found = outcomes(
        statuses(
            (2, QUEUED, B, math.nan, 0.0),
            (1, ACTIVE, A, 10.0, 0.0),
            (1, REACHED, A, 0.9, 9.5),
            (2, ACTIVE, B, 10.5, 0.0),
            (2, MISSED, B, 2.0, 30.0),
        )
    )
    assert [goal.position for goal in found] == [A, B]
    assert [goal.status for goal in found] == [Status.REACHED, Status.MISSED]
    assert found[0].straight == 10.0 - 0.9
    assert found[0].path_length == 9.5


def test_a_goal_sent_again_to_a_new_controller_counts_once() -> None:
    found = outcomes(
        statuses(
            (2, QUEUED, B, math.nan, 0.0),
            (3, QUEUED, C, math.nan, 0.0),
            (1, ACTIVE, A, 10.0, 0.0),
            (1, REACHED, A, 0.9, 9.5),
            (2, ACTIVE, B, 10.5, 0.0),
            # Killed; the next one counts from 1 again and first takes over the goal it finds.
            (1, ACTIVE, B, 7.0, 0.0),
            (1, REPLACED, B, 6.0, 1.0),
            (3, QUEUED, C, math.nan, 0.0),
            (2, ACTIVE, B, 6.0, 0.0),
            (2, REACHED, B, 0.8, 5.4),
            (3, ACTIVE, C, 11.0, 0.0),
            (3, GIVEN_UP, C, 4.0, 80.0),
        )
    )
    assert [(goal.position, goal.status) for goal in found] == [
        (A, Status.REACHED),
        (B, Status.REACHED),
        (C, Status.GIVEN_UP),
    ]


def test_a_controller_killed_on_its_first_goal_is_noticed() -> None:
    found = outcomes(
        statuses(
            (1, ACTIVE, A, 10.0, 0.0),
            (1, ACTIVE, A, 8.0, 0.0),
            (1, REACHED, A, 0.5, 7.6),
        )
    )
    assert [(goal.status, goal.straight) for goal in found] == [(Status.REACHED, 7.5)]


def test_going_twice_to_one_place_counts_twice() -> None:
    found = outcomes(
        statuses(
            (1, ACTIVE, A, 10.0, 0.0),
            (1, REACHED, A, 0.5, 9.6),
            (2, ACTIVE, B, 10.0, 0.0),
            (2, REACHED, B, 0.5, 9.6),
            (3, ACTIVE, A, 10.0, 0.0),
            (3, REACHED, A, 0.5, 9.6),
        )
    )
    assert [goal.position for goal in found] == [A, B, A]


def test_rejected_goals_do_not_count_and_open_ones_stay_open() -> None:
    found = outcomes(
        statuses((0, REJECTED, A, math.nan, 0.0), (1, ACTIVE, B, 10.0, 0.0)),
    )
    assert [(goal.position, goal.status) for goal in found] == [(B, Status.ACTIVE)]
    assert outcomes({}) == []


def test_a_plan_goes_on_only_with_its_present_goal() -> None:
    plan = Plan([A, B])
    assert plan.take(B, Status.REACHED) is None
    assert plan.take(A, Status.ACTIVE) is None
    assert plan.take(A, Status.CANCELLED) is None
    assert (plan.number, plan.remaining) == (1, [A, B])
    assert plan.take(A, Status.FALLEN) == 1
    assert (plan.number, plan.remaining, plan.finished) == (2, [B], False)
    assert plan.take(B, Status.REACHED) == 2
    assert (plan.number, plan.remaining, plan.finished) == (2, [], True)
    assert plan.take(B, Status.REACHED) is None
