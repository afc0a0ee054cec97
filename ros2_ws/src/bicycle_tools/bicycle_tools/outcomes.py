"""What became of each goal, from the status messages of one ride."""

from __future__ import annotations

from dataclasses import dataclass

from bicycle_common.types import Point2D
from bicycle_controller.control.goals import Status
from bicycle_tools.recorded_here import OPEN
from bicycle_tools.ride_log import Columns

DECIDED = (Status.REACHED, Status.MISSED, Status.GIVEN_UP, Status.FALLEN)
"""What a controller makes of a goal by itself; anything else leaves it to be ridden to again."""


@dataclass(frozen=True)
class Outcome:
    """One goal as it ended."""

    position: Point2D
    status: Status
    straight: float
    """m along the straight line that were to be ridden; NaN if it never became active."""
    path_length: float
    """m ridden to it."""
    elapsed: float
    """s of simulated time on the way to it."""
    known_at: float = float("nan")
    """s, log time of the last word on it; NaN where the columns have none."""
    place: int = -1
    """Place of that word in the bag's recorded order; -1 where the columns have none."""
    message: str = ""
    """That word, for a person."""
    begun_before: bool = False
    """True if it was under way when the recording began: the numbers count from before."""


def outcomes(statuses: Columns) -> list[Outcome]:
    """Return the goals of a ride in the order they were taken, each once.

    A goal that was still open when the controller died or the bicycle fell, and that was sent
    again, counts once, as it ended at last.

    Args:
        statuses: columns of GoalStatus.
    """
    goals: dict[tuple[int, int], Outcome] = {}
    life = 0  # a controller that is started anew counts goals from 1 again
    for row in range(len(statuses.get("status", ()))):
        status = Status(int(statuses["status"][row]))
        if status is Status.REJECTED:
            continue
        number = int(statuses["goal_id"][row])
        position = (float(statuses["position.x"][row]), float(statuses["position.y"][row]))
        known = goals.get((life, number))
        if known and status in OPEN and (known.status not in OPEN or known.position != position):
            life, known = life + 1, None
        goals[life, number] = _update(known, position, status, statuses, row)
    # Waiting goals are announced before the first one becomes active: put them in their order.
    return _without_resent([goals[key] for key in sorted(goals)])


def _update(
    known: Outcome | None, position: Point2D, status: Status, statuses: Columns, row: int
) -> Outcome:
    """Return the goal after one more status message."""
    distance = float(statuses["distance"][row])
    straight = distance if status is Status.ACTIVE else known.straight if known else float("nan")
    if status is Status.REACHED and not (known and known.status is Status.REACHED):
        straight -= distance
    begun_before = bool(known and known.begun_before)
    if status is Status.ACTIVE:
        begun_before = bool("before" in statuses and statuses["before"][row])
    return Outcome(
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


def _without_resent(goals: list[Outcome]) -> list[Outcome]:
    """Leave out those that were left open and sent again later."""
    kept: list[Outcome] = []
    later: set[Point2D] = set()
    for goal in reversed(goals):
        if goal.status in DECIDED or goal.position not in later:
            kept.append(goal)
        later.add(goal.position)
    return kept[::-1]
