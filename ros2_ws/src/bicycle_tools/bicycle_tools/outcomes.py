"""Outcome of each goal, from the status messages of one ride."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bicycle_common.types import Point2D
from bicycle_controller.control.goals import Status
from bicycle_tools.recorded_here import OPEN
from bicycle_tools.ride_log import Columns

DECIDED = (Status.REACHED, Status.MISSED, Status.GIVEN_UP, Status.FALLEN)
"""Final statuses set by the controller; a goal with any other may be pursued again."""


@dataclass(frozen=True)
class GoalOutcome:
    """Outcome of one goal."""

    position: Point2D
    status: Status
    straight: float
    """Length of the straight line to the goal, m; NaN if it never became active."""
    path_length: float
    """Distance ridden to it, m."""
    elapsed: float
    """Simulated time of the pursuit, s."""
    known_at: float = float("nan")
    """Log time of its last status, s; NaN if the columns have none."""
    place: int = -1
    """Place of that status in the bag's recorded order; -1 if the columns have none."""
    message: str = ""
    """Message of that status."""
    begun_before: bool = False
    """True if it was active when the recording began: its numbers count from before."""


def outcomes(statuses: Columns) -> list[GoalOutcome]:
    """Return the goals of a ride in the order of acceptance, each once.

    A goal that was open when the controller died or the bicycle fell, and was sent again, counts
    once, with its final outcome.

    Args:
        statuses: columns of GoalStatus.
    """
    goals: dict[tuple[int, int], GoalOutcome] = {}
    life = 0  # a restarted controller counts goals from 1 again
    for row in range(len(statuses.get("status", ()))):
        number = int(statuses["status"][row])
        status = Status(number) if number in set(Status) else Status.REJECTED
        if status is Status.REJECTED:  # or of a later release, see `unknown`
            continue
        number = int(statuses["goal_id"][row])
        position = (float(statuses["position.x"][row]), float(statuses["position.y"][row]))
        known = goals.get((life, number))
        if known and status in OPEN and (known.status not in OPEN or known.position != position):
            life, known = life + 1, None
        goals[life, number] = _update(known, position, status, statuses, row)
    # Waiting goals are announced before the first one becomes active: sort them.
    return _without_resent([goals[key] for key in sorted(goals)])


def unknown(statuses: Columns) -> int:
    """Return the number of statuses of a later release, which `outcomes` leaves out.

    Args:
        statuses: columns of GoalStatus.
    """
    return int((~np.isin(statuses.get("status", ()), list(Status))).sum())


def _update(
    known: GoalOutcome | None, position: Point2D, status: Status, statuses: Columns, row: int
) -> GoalOutcome:
    """Return the goal updated with one more status message."""
    distance = float(statuses["distance"][row])
    straight = distance if status is Status.ACTIVE else known.straight if known else float("nan")
    if status is Status.REACHED and not (known and known.status is Status.REACHED):
        straight -= distance
    begun_before = bool(known and known.begun_before)
    if status is Status.ACTIVE:
        begun_before = bool("before" in statuses and statuses["before"][row])
    return GoalOutcome(
        position=position,
        status=status,
        straight=straight,
        path_length=float(statuses["path_length"][row]),
        elapsed=float(statuses["elapsed"][row]),
        known_at=float(statuses["log_time"][row]) if "log_time" in statuses else float("nan"),
        place=int(statuses["recorded_order"][row]) if "recorded_order" in statuses else -1,
        message=str(statuses["message"][row]) if "message" in statuses else "",
        begun_before=begun_before,
    )


def _without_resent(goals: list[GoalOutcome]) -> list[GoalOutcome]:
    """Drop goals that were left open and sent again later."""
    kept: list[GoalOutcome] = []
    later: set[Point2D] = set()
    for goal in reversed(goals):
        if goal.status in DECIDED or goal.position not in later:
            kept.append(goal)
        later.add(goal.position)
    return kept[::-1]
