"""Goals ahead, from the paths sent to the controller and its reports."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from bicycle_common.types import Point2D
from bicycle_controller.control.goals import Status

ENDS = (Status.REACHED, Status.MISSED, Status.GIVEN_UP, Status.FALLEN, Status.CANCELLED)
MOST_ECHOES = 100
"""Largest number of own paths expected back from the topic."""


class GoalList:
    """Active goal and those after it.

    The controller reports changes one by one, and the oldest of a long path may be lost; so the
    path is kept as sent, and the number of remaining goals gives the bicycle's place in it.
    Until the controller has accepted a path, which is late on a busy machine and waits for a
    reset while the bicycle lies, that path is the one ahead.

    Attributes:
        active: the goal that is pursued.
        ahead: waiting goals, in order.
    """

    def __init__(self) -> None:
        self.active: Point2D | None = None
        self.ahead: list[Point2D] = []
        self._headed: tuple[Point2D, float | None] | None = None
        self._path: list[Point2D] = []
        self._untaken: list[Point2D] | None = None
        self._echoes: deque[list[Point2D]] = deque(maxlen=MOST_ECHOES)

    @property
    def is_taken(self) -> bool:
        """Return True if the controller has accepted what was sent last."""
        return self._untaken is None

    @property
    def heading(self) -> float | None:
        """Return the yaw with which the active goal is to be reached, rad; None for any."""
        known = self._headed is not None and self._headed[0] == self.active
        return self._headed[1] if self._headed is not None and known else None

    def headed(self, point: Point2D, yaw: float | None) -> None:
        """Take in the direction of arrival at a goal, reported by the controller."""
        self._headed = point, yaw

    def send(self, points: Sequence[Point2D]) -> None:
        """Take in a path, or one goal, that this cockpit sends; the topic returns it later."""
        self._echoes.append(list(points))
        self._put(list(points))

    def sent(self, points: Sequence[Point2D]) -> None:
        """Take in a path, or one goal, received from the topic."""
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
        """Take in a goal's change reported by the controller."""
        if status == Status.ACTIVE:
            path = self._untaken
            if path and remaining < len(path) and path[-1 - remaining] == position:
                self._path, self._untaken = path, None
            self.active = position
            self.ahead = self._path[len(self._path) - remaining :] if remaining else []
        elif status == Status.REJECTED:
            # Compared as text, because a rejected point may be NaN.
            if self._untaken and str(position) == str(self._untaken[0]):
                self._untaken = None
        elif status in ENDS and position == self.active:
            self.active = None
            if remaining == 0:
                self.ahead = []

    def with_more(self, points: Sequence[Point2D]) -> list[Point2D]:
        """Return all goals ahead, followed by these points."""
        if self._untaken is not None:
            return [*self._untaken, *points]
        return [*([self.active] if self.active else []), *self.ahead, *points]
