"""Which goals lie ahead, from what is sent to the controller and what it says of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from bicycle_common.types import Point2D
from bicycle_controller.control.goals import Status

ENDS = (Status.REACHED, Status.MISSED, Status.GIVEN_UP, Status.FALLEN, Status.CANCELLED)
MOST_ECHOES = 100
"""Own paths that are expected back from the topic."""


class GoalList:
    """The active goal and those after it.

    The controller tells changes one by one, and of a long path the oldest may be lost on the
    way; so the path as it was sent is kept, and the number of goals that remain says where in
    it the bicycle is. Until the controller has taken a path, which on a busy machine comes
    late and while the bicycle lies only after a reset, that path is what lies ahead.

    Attributes:
        active: the goal that is ridden to.
        ahead: those that wait, in order.
    """

    def __init__(self) -> None:
        self.active: Point2D | None = None
        self.ahead: list[Point2D] = []
        self._path: list[Point2D] = []
        self._untaken: list[Point2D] | None = None
        self._echoes: deque[list[Point2D]] = deque(maxlen=MOST_ECHOES)

    def send(self, points: Sequence[Point2D]) -> None:
        """This cockpit sends this path, or one goal; the topic brings it back later."""
        self._echoes.append(list(points))
        self._put(list(points))

    def sent(self, points: Sequence[Point2D]) -> None:
        """The topic brought this path, or one goal."""
        path = list(points)
        if path in self._echoes:
            self._echoes.remove(path)
        else:
            self._put(path)

    def _put(self, path: list[Point2D]) -> None:
        self._untaken = path or None
        if not path:
            self.active, self.ahead, self._path = None, [], []

    def changed(self, status: int, position: Point2D, remaining: int) -> None:
        """The controller told a goal's change."""
        if status == Status.ACTIVE:
            path = self._untaken
            if path and remaining < len(path) and path[-1 - remaining] == position:
                self._path, self._untaken = path, None
            self.active = position
            self.ahead = self._path[len(self._path) - remaining :] if remaining else []
        elif status == Status.REJECTED:
            # Compared as text: what is rejected may be NaN.
            if self._untaken and str(position) == str(self._untaken[0]):
                self._untaken = None
        elif status in ENDS and position == self.active:
            self.active = None
            if remaining == 0:
                self.ahead = []

    def with_more(self, points: Sequence[Point2D]) -> list[Point2D]:
        """Return all that lies ahead and then these."""
        if self._untaken is not None:
            return [*self._untaken, *points]
        return [*([self.active] if self.active else []), *self.ahead, *points]
