"""Goals of a ride: their queue, their results, and the direction to steer in.

Headings use the paper's signs: psi counter-clockwise from +y, psi_g positive to the right.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from bicycle_common.geometry import heading_error, wrap_angle
from bicycle_common.types import Point2D
from bicycle_common.validation import require

NO_GOALS = "all goals were cleared"
"""Default reason of cancelled goals; see `GoalTracker.cancel`."""

MOST_TOLD = 10_000
"""Largest number of goals replaced before a state came whose end is reported: the last ones."""

PROGRESS = 0.1
"""Improvement of the closest approach that counts as progress of an orbit, m."""


class Status(IntEnum):
    """Status of a goal; the numbers are those of GoalStatus."""

    QUEUED = 0
    ACTIVE = 1
    REACHED = 2
    MISSED = 3
    GIVEN_UP = 4
    REPLACED = 5
    FALLEN = 6
    REJECTED = 7
    CANCELLED = 8


@dataclass(frozen=True)
class Goal:
    """A place to ride to."""

    goal_id: int
    """Number of the goal; accepted goals count from 1."""
    point: Point2D
    """m."""


@dataclass(frozen=True)
class Pose:
    """Data of the bicycle that the tracker needs at one step."""

    episode: int
    time: float
    """Simulated time, s; it continues over resets."""
    x: float
    """m, rear contact."""
    y: float
    """m, rear contact."""
    heading: float
    """rad (psi)."""
    fallen: bool = False


@dataclass(frozen=True)
class Event:
    """Change of a goal's status, reported once."""

    status: Status
    goal: Goal
    distance: float
    """Distance from the rear contact, m."""
    elapsed: float
    """Simulated time since the goal became active, s."""
    path_length: float
    """Distance ridden since then, m."""
    remaining: int
    """Number of goals still queued."""
    message: str


class _Pursuit:
    """Progress towards one goal so far."""

    def __init__(self, goal: Goal, pose: Pose) -> None:
        self.goal = goal
        self.path_length = 0.0
        self.distance = self._distance_from(pose)
        self.turned = 0.0
        self._begun = pose.time
        self._last = pose
        self._closest = self.distance

    def _distance_from(self, pose: Pose) -> float:
        return math.hypot(self.goal.point[0] - pose.x, self.goal.point[1] - pose.y)

    @property
    def elapsed(self) -> float:
        """Simulated time of the pursuit, s."""
        return self._last.time - self._begun

    def move(self, pose: Pose) -> None:
        """Add one step; `turned` (rad) is the turning since the last real approach."""
        self.path_length += math.hypot(pose.x - self._last.x, pose.y - self._last.y)
        self.turned += float(wrap_angle(pose.heading - self._last.heading))
        self.distance = self._distance_from(pose)
        if self.distance < self._closest - PROGRESS:
            self._closest = self.distance
            self.turned = 0.0
        self._last = pose


class GoalTracker:
    """Tracks goals one after another; after the last one it holds the heading of that moment.

    New goals wait for the next `update`; only `update` reports events.
    """

    def __init__(self, radius: float = 1.0, timeout: float = 300.0, turns: float = 2.0) -> None:
        """Create a tracker without goals.

        Args:
            radius: distance from the rear contact at which a goal is reached, m (row 26).
            timeout: simulated time after which a goal is given up, s; zero disables this.
            turns: full turns in one direction without an approach after which a goal is missed.

        Raises:
            ValueError: on a radius or a number of turns that is not above zero.
        """
        require(radius > 0 and turns > 0, "radius and turns must be above zero")
        self.radius = radius
        self.timeout = timeout
        self.turns = turns
        self.on_the_way = False
        """True while the way leads past the active goal: it is not reached before it is over."""
        self._next_id = 1
        self._incoming: list[Goal] | None = None
        self._superseded: list[Goal] = []
        self._announced = False
        self._why_none = NO_GOALS
        self._queue: deque[Goal] = deque()
        self._pursuit: _Pursuit | None = None
        self._held_heading: float | None = None
        self._episode: int | None = None
        self._time = -math.inf

    @property
    def active(self) -> Goal | None:
        """Goal that is being pursued; None without one."""
        return self._pursuit.goal if self._pursuit else None

    @property
    def distance(self) -> float:
        """Distance from the rear contact to the active goal, m; NaN without one."""
        return self._pursuit.distance if self._pursuit else math.nan

    @property
    def has_goal(self) -> bool:
        """True if a goal is being pursued."""
        return self._pursuit is not None

    @property
    def steers(self) -> bool:
        """True if there is a goal to pursue or a heading to hold."""
        return self.has_goal or self._held_heading is not None

    @property
    def waiting(self) -> int:
        """Number of goals that are not active yet."""
        return len(self._queue) + len(self._incoming or [])

    def replace(self, points: Sequence[Point2D]) -> list[Goal]:
        """Pursue these points, in order, instead of all previous goals; stop aiming if empty."""
        self._superseded = (self._superseded + (self._incoming or []))[-MOST_TOLD:]
        self._incoming = self._numbered(points)
        self._announced = False
        self._why_none = NO_GOALS
        return self._incoming

    def cancel(self, why: str) -> None:
        """Cancel all goals, hold the heading, and report `why`."""
        self.replace([])
        self._why_none = why

    def append(self, points: Sequence[Point2D]) -> list[Goal]:
        """Pursue these points, in order, after all previous goals."""
        added = self._numbered(points)
        if self._incoming is not None:
            self._incoming += added
        else:
            self._queue.extend(added)
        return added

    def hold(self, heading: float) -> None:
        """Hold this heading (psi, rad) while there is no goal."""
        self._held_heading = heading

    def heading_error(self, pose: Pose) -> float:
        """Return psi_g in rad: to the active goal or the held heading; zero without either."""
        if self._pursuit:
            goal = self._pursuit.goal.point
            return float(heading_error(pose.heading, pose.x, pose.y, *goal))
        if self._held_heading is not None:
            return float(wrap_angle(pose.heading - self._held_heading))
        return 0.0

    def update(self, pose: Pose) -> list[Event]:
        """Take in the state of one step; return the changes, in order."""
        newer, self._superseded = self._superseded, []
        events = [self._waits(goal, "a newer goal came", Status.REPLACED) for goal in newer]
        if pose.time < self._time:
            self._start_again(pose)
        elif self._episode not in (None, pose.episode):
            events += self._drop(Status.CANCELLED, Status.CANCELLED, "the simulator was reset")
        self._episode, self._time = pose.episode, pose.time
        if pose.fallen:
            events += self._drop(Status.FALLEN, Status.CANCELLED, "the bicycle fell")
            return events + self._announce()
        if self._incoming is not None:
            events += self._take_incoming(pose)
        if self._pursuit:
            self._pursuit.move(pose)
        return events + self._advance(pose)

    def resumed(self) -> list[Event]:
        """Report the active goal again, after another controller has driven for some time."""
        if not self._pursuit:
            return []
        text = f"{self._pursuit.distance:.1f} m to go"
        return [self._event(Status.ACTIVE, self._pursuit, text)]

    def _start_again(self, pose: Pose) -> None:
        """Restart the pursuit from this pose after a restart of the simulator; keep the goals."""
        self._held_heading = None
        if self._pursuit:
            self._pursuit = _Pursuit(self._pursuit.goal, pose)

    def _numbered(self, points: Sequence[Point2D]) -> list[Goal]:
        goals = [Goal(self._next_id + i, point) for i, point in enumerate(points)]
        self._next_id += len(goals)
        return goals

    def _take_incoming(self, pose: Pose) -> list[Event]:
        """Replace the old goals by the new ones."""
        incoming, self._incoming = self._incoming or [], None
        if incoming:
            events = self._drop(Status.REPLACED, Status.REPLACED, "a newer goal came")
        else:
            had_goals = self.has_goal
            events = self._drop(Status.CANCELLED, Status.CANCELLED, self._why_none)
            if had_goals:
                self.hold(pose.heading)
        self._queue.extend(incoming)
        waiting = incoming[1:] if not self._announced else []
        return events + [self._waits(goal, "waits for the goals before it") for goal in waiting]

    def _announce(self) -> list[Event]:
        """Report once that goals wait for a fallen bicycle to be reset."""
        if self._announced or not self._incoming:
            return []
        self._announced = True
        text = "the bicycle lies: this goal waits for a reset"
        return [self._waits(goal, text) for goal in self._incoming]

    def _advance(self, pose: Pose) -> list[Event]:
        """Finish the active goal if it is over, and start the next."""
        events: list[Event] = []
        while True:
            if self._pursuit:
                end = self._verdict(self._pursuit)
                if end is None:
                    return events
                events.append(self._event(end[0], self._pursuit, end[1]))
                self._pursuit = None
                self.hold(pose.heading)
            if not self._queue:
                return events
            self._pursuit = _Pursuit(self._queue.popleft(), pose)
            text = f"{self._pursuit.distance:.1f} m to go"
            events.append(self._event(Status.ACTIVE, self._pursuit, text))

    def _verdict(self, way: _Pursuit) -> tuple[Status, str] | None:
        """Return status and reason if a pursuit is over; None if it is not."""
        if way.distance <= self.radius and not self.on_the_way:
            return Status.REACHED, f"reached after {way.elapsed:.1f} s and {way.path_length:.1f} m"
        if abs(way.turned) >= 2.0 * math.pi * self.turns and not self.on_the_way:
            return Status.MISSED, f"orbits the goal at {way.distance:.1f} m: send it again"
        if 0 < self.timeout <= way.elapsed:
            return Status.GIVEN_UP, f"not reached in {self.timeout:g} s: see goal_timeout"
        return None

    def _drop(self, active: Status, queued: Status, why: str) -> list[Event]:
        """Drop the active and the queued goals."""
        queue, self._queue = list(self._queue), deque()
        events = []
        if self._pursuit:
            events.append(self._event(active, self._pursuit, why))
        self._pursuit = None
        self._held_heading = None if active is not Status.REPLACED else self._held_heading
        return events + [self._waits(goal, why, queued) for goal in queue]

    def _event(self, status: Status, way: _Pursuit, message: str) -> Event:
        return Event(
            status,
            way.goal,
            distance=way.distance,
            elapsed=way.elapsed,
            path_length=way.path_length,
            remaining=len(self._queue),
            message=message,
        )

    def _waits(self, goal: Goal, message: str, status: Status = Status.QUEUED) -> Event:
        """Return an event of a goal that was never pursued."""
        return Event(status, goal, math.nan, 0.0, 0.0, len(self._queue), message)
