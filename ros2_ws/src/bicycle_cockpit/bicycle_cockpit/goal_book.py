"""Which goals lie ahead, from what is sent to the controller and what it says of them."""

from __future__ import annotations

from collections.abc import Sequence

from bicycle_controller.goals import Status

Point = tuple[float, float]
"""(x, y), m."""

ENDS = (Status.REACHED, Status.MISSED, Status.GIVEN_UP, Status.FALLEN, Status.CANCELLED)


class GoalBook:
    """The active goal and those after it.

    The controller tells changes one by one, and of a long path the oldest may be lost on the
    way; so the path as it was sent is kept, and the number of goals that remain says where in
    it the bicycle is.

    Attributes:
        active: the goal that is ridden to.
        ahead: those that wait, in order.
    """

    def __init__(self) -> None:
        self.active: Point | None = None
        self.ahead: list[Point] = []
        self._path: list[Point] = []

    def sent(self, points: Sequence[Point]) -> None:
        """Somebody sent this path, or one goal."""
        self._path = list(points)
        if not points:
            self.active, self.ahead = None, []

    def changed(self, status: int, position: Point, remaining: int) -> None:
        """The controller told a goal's change."""
        if status == Status.ACTIVE:
            self.active = position
            self.ahead = self._path[len(self._path) - remaining :] if remaining else []
        elif status in ENDS and position == self.active:
            self.active = None
            if remaining == 0:
                self.ahead = []

    def with_more(self, points: Sequence[Point]) -> list[Point]:
        """All that lies ahead and then these."""
        return [*([self.active] if self.active else []), *self.ahead, *points]
