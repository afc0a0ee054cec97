"""Goals of a ride and their progress; which ones to send again after a failure."""

from __future__ import annotations

from dataclasses import dataclass, field

from bicycle_common.types import Point2D
from bicycle_controller.control.goals import Status
from bicycle_tools.outcomes import DECIDED


@dataclass
class Plan:
    """Goals pursued one after another, each decided once.

    Attributes:
        goals: m, all of them in order.
        results: statuses of the decided ones.
    """

    goals: list[Point2D]
    results: list[Status] = field(default_factory=list)

    @property
    def remaining(self) -> list[Point2D]:
        """Goals that are not decided yet, the current one first."""
        return self.goals[len(self.results) :]

    @property
    def number(self) -> int:
        """Number of the current goal, from 1; that of the last one if all are decided."""
        return min(len(self.results) + 1, len(self.goals))

    @property
    def finished(self) -> bool:
        """True if every goal is decided."""
        return not self.remaining

    def take(self, position: Point2D, status: Status) -> int | None:
        """Take in a goal's change.

        Args:
            position: m, of the goal.
            status: new status of the goal.

        Returns:
            The number of the goal that this decides; None if it decides none.
        """
        if status not in DECIDED or self.finished or position != self.remaining[0]:
            return None
        self.results.append(status)
        return len(self.results)
