"""The goals of a ride and how far it has come; what to send again after a mishap."""

from __future__ import annotations

from dataclasses import dataclass, field

from bicycle_common.types import Point2D
from bicycle_controller.control.goals import Status
from bicycle_tools.outcomes import DECIDED


@dataclass
class Plan:
    """Goals that are ridden to one after the other, each decided once.

    Attributes:
        goals: m, all of them in order.
        results: what became of the first ones.
    """

    goals: list[Point2D]
    results: list[Status] = field(default_factory=list)

    @property
    def remaining(self) -> list[Point2D]:
        """Goals that are still to be ridden to, the present one first."""
        return self.goals[len(self.results) :]

    @property
    def number(self) -> int:
        """The present goal's number, from 1; that of the last one when all are decided."""
        return min(len(self.results) + 1, len(self.goals))

    @property
    def finished(self) -> bool:
        """True if every goal is decided."""
        return not self.remaining

    def take(self, position: Point2D, status: Status) -> int | None:
        """Take in a goal's change.

        Args:
            position: m, of the goal.
            status: what became of it.

        Returns:
            The number of the goal that this decides; None if it decides none.
        """
        if status not in DECIDED or self.finished or position != self.remaining[0]:
            return None
        self.results.append(status)
        return len(self.results)
