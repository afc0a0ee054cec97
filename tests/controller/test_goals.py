"""Goals: reached, missed, given up, replaced, and where to steer meanwhile."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from bicycle_controller.control.goals import Event, GoalTracker, Pose, Status

DT = 0.025
HERE = Pose(episode=1, time=0.0, x=0.0, y=0.0, heading=0.0)


def statuses(events: list[Event]) -> list[tuple[int, Status]]:
    return [(event.goal.goal_id, event.status) for event in events]


def straight(tracker: GoalTracker, pose: Pose, metres: float) -> tuple[Pose, list[Event]]:
    """Ride straight on at 2.5 m/s; headings are the paper's."""
    events: list[Event] = []
    for _ in range(round(metres / (2.5 * DT))):
        pose = replace(
            pose,
            time=pose.time + DT,
            x=pose.x - 2.5 * DT * math.sin(pose.heading),
            y=pose.y + 2.5 * DT * math.cos(pose.heading),
        )
        events += tracker.update(pose)
    return pose, events


def circle(tracker: GoalTracker, radius: float, turns: float) -> list[Event]:
    """Ride left-hand circles about (0, 0), beginning at (radius, 0)."""
    events: list[Event] = []
    steps = round(2 * math.pi * turns / 0.02)
    for step in range(steps + 1):
        angle = 0.02 * step
        heading = math.remainder(angle, 2 * math.pi)
        pose = Pose(1, DT * step, radius * math.cos(angle), radius * math.sin(angle), heading)
        events += tracker.update(pose)
    return events


def test_a_goal_is_reached_and_the_way_is_measured() -> None:
    tracker = GoalTracker(radius=1.0)
    tracker.replace([(0.0, 10.0)])
    assert statuses(tracker.update(HERE)) == [(1, Status.ACTIVE)]
    _, events = straight(tracker, HERE, 12.0)
    (reached,) = events
    assert reached.status is Status.REACHED
    assert reached.distance == pytest.approx(1.0, abs=0.07)
    assert reached.path_length == pytest.approx(9.0, abs=0.07)
    assert reached.elapsed == pytest.approx(9.0 / 2.5, abs=0.03)


@pytest.mark.parametrize(
    ("goal", "expected"),
    [((0.0, 9.0), 0.0), ((9.0, 0.0), math.pi / 2), ((-9.0, 0.0), -math.pi / 2)],
)
def test_the_error_is_positive_for_a_goal_to_the_right(
    goal: tuple[float, float], expected: float
) -> None:
    tracker = GoalTracker()
    tracker.replace([goal])
    tracker.update(HERE)
    assert tracker.heading_error(HERE) == pytest.approx(expected)


def test_waypoints_are_ridden_in_order_and_then_the_heading_is_held() -> None:
    tracker = GoalTracker()
    tracker.replace([(0.0, 5.0), (0.0, 10.0)])
    first = tracker.update(HERE)
    assert statuses(first) == [(2, Status.QUEUED), (1, Status.ACTIVE)]
    assert first[-1].remaining == 1
    pose, events = straight(tracker, HERE, 12.0)
    assert statuses(events) == [(1, Status.REACHED), (2, Status.ACTIVE), (2, Status.REACHED)]
    assert not tracker.has_goal
    assert tracker.steers
    assert tracker.heading_error(replace(pose, heading=0.3)) == pytest.approx(0.3)


def test_a_new_goal_replaces_all() -> None:
    tracker = GoalTracker()
    tracker.replace([(0.0, 50.0), (0.0, 60.0)])
    tracker.update(HERE)
    tracker.replace([(5.0, 5.0)])
    assert statuses(tracker.update(HERE)) == [
        (1, Status.REPLACED),
        (2, Status.REPLACED),
        (3, Status.ACTIVE),
    ]


def test_goals_can_be_appended() -> None:
    tracker = GoalTracker()
    tracker.replace([(0.0, 5.0)])
    tracker.append([(0.0, 10.0)])
    tracker.update(HERE)
    tracker.append([(0.0, 15.0)])
    _, events = straight(tracker, HERE, 17.0)
    reached = [number for number, status in statuses(events) if status is Status.REACHED]
    assert reached == [1, 2, 3]


def test_none_of_a_flood_of_goals_is_lost() -> None:
    tracker = GoalTracker()
    for number in range(1000):
        tracker.replace([(float(number), 50.0)])
    events = statuses(tracker.update(HERE))
    assert events == [(i, Status.REPLACED) for i in range(1, 1000)] + [(1000, Status.ACTIVE)]


def test_an_empty_path_stops_aiming_and_rides_straight_on() -> None:
    tracker = GoalTracker()
    tracker.replace([(0.0, 50.0), (1.0, 1.0)])
    tracker.update(HERE)
    tracker.replace([])
    turned = replace(HERE, heading=0.5)
    assert statuses(tracker.update(turned)) == [(1, Status.CANCELLED), (2, Status.CANCELLED)]
    assert tracker.steers
    assert tracker.heading_error(turned) == 0.0


@pytest.mark.parametrize("goal", [(0.0, 0.0), (9.0, 0.0)], ids=["inside", "beside the circle"])
def test_two_circles_without_coming_nearer_are_a_miss(goal: tuple[float, float]) -> None:
    tracker = GoalTracker(radius=1.0, turns=2.0)
    tracker.replace([goal])
    assert statuses(circle(tracker, 5.0, 1.9)) == [(1, Status.ACTIVE)]
    assert statuses(circle(tracker, 5.0, 2.2))[-1] == (1, Status.MISSED)


def test_a_spiral_that_comes_nearer_is_no_miss() -> None:
    tracker = GoalTracker(radius=1.0, turns=2.0)
    tracker.replace([(0.0, 0.0)])
    events: list[Event] = []
    for step in range(4000):
        angle, radius = 0.02 * step, 5.0 - 0.001 * step
        heading = math.remainder(angle, 2 * math.pi)
        pose = Pose(1, DT * step, radius * math.cos(angle), radius * math.sin(angle), heading)
        events += tracker.update(pose)
    assert statuses(events) == [(1, Status.ACTIVE)]


def test_a_weaving_ride_is_no_miss() -> None:
    tracker = GoalTracker(turns=2.0)
    tracker.replace([(0.0, 500.0)])
    events: list[Event] = []
    for step in range(4000):
        heading = 2.0 * math.sin(0.05 * step)
        events += tracker.update(Pose(1, DT * step, 0.0, 0.0, heading))
    assert statuses(events) == [(1, Status.ACTIVE)]


def test_a_goal_is_given_up_in_simulated_time() -> None:
    tracker = GoalTracker(timeout=3.0)
    tracker.replace([(0.0, 500.0), (0.0, 400.0)])
    tracker.update(HERE)
    assert tracker.update(replace(HERE, time=2.99)) == []
    assert statuses(tracker.update(replace(HERE, time=3.0))) == [
        (1, Status.GIVEN_UP),
        (2, Status.ACTIVE),
    ]


def test_a_fall_ends_all_goals_and_steering() -> None:
    tracker = GoalTracker()
    tracker.replace([(0.0, 50.0), (0.0, 60.0)])
    tracker.update(HERE)
    down = replace(HERE, fallen=True)
    assert statuses(tracker.update(down)) == [(1, Status.FALLEN), (2, Status.CANCELLED)]
    assert tracker.update(down) == []
    assert not tracker.steers


def test_a_fall_inside_the_goal_is_not_counted_as_reached() -> None:
    tracker = GoalTracker(radius=1.0)
    tracker.replace([(0.0, 10.0)])
    tracker.update(HERE)
    inside = replace(HERE, y=9.5, time=1.0, fallen=True)
    assert statuses(tracker.update(inside)) == [(1, Status.FALLEN)]
    assert tracker.update(replace(inside, time=1.1)) == []


def test_a_goal_for_a_fallen_bicycle_waits_for_the_reset() -> None:
    tracker = GoalTracker()
    down = replace(HERE, fallen=True)
    tracker.update(down)
    tracker.replace([(0.0, 50.0)])
    (event,) = tracker.update(down)
    assert event.status is Status.QUEUED
    assert "waits for a reset" in event.message
    assert tracker.update(down) == []
    assert statuses(tracker.update(replace(HERE, episode=2))) == [(1, Status.ACTIVE)]


def test_a_reset_cancels_the_goals_from_before_it_only() -> None:
    tracker = GoalTracker()
    tracker.replace([(0.0, 50.0), (0.0, 60.0)])
    tracker.update(HERE)
    tracker.replace([(0.0, 70.0)])
    assert statuses(tracker.update(replace(HERE, episode=2))) == [
        (1, Status.CANCELLED),
        (2, Status.CANCELLED),
        (3, Status.ACTIVE),
    ]


def test_a_simulator_started_again_keeps_its_goals() -> None:
    tracker = GoalTracker()
    tracker.replace([(0.0, 50.0)])
    late = replace(HERE, episode=3, time=100.0, y=30.0)
    tracker.update(late)
    anew = replace(HERE, episode=1, time=0.0)
    assert tracker.update(anew) == []
    assert tracker.has_goal
    _, events = straight(tracker, anew, 50.0)
    (reached,) = events
    assert reached.status is Status.REACHED
    assert reached.path_length == pytest.approx(49.0, abs=0.07)


def test_a_goal_underfoot_is_reached_at_once() -> None:
    tracker = GoalTracker()
    tracker.replace([(0.5, 0.0)])
    assert statuses(tracker.update(HERE)) == [(1, Status.ACTIVE), (1, Status.REACHED)]


@pytest.mark.parametrize(("radius", "turns"), [(0.0, 2.0), (1.0, -1.0), (math.nan, 2.0)])
def test_impossible_settings_are_refused(radius: float, turns: float) -> None:
    with pytest.raises(ValueError, match="above zero"):
        GoalTracker(radius=radius, turns=turns)
