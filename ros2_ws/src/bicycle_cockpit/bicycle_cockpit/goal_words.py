"""Descriptions of goals' changes, for live rides and bags alike."""

from __future__ import annotations

import math

from bicycle_common.types import Point2D
from bicycle_controller.control.goals import Status

UNTOLD = (Status.QUEUED, Status.REPLACED)
"""Changes that are not reported: the goal that replaces this one is."""
LEVELS = {
    Status.REACHED: "good",
    Status.MISSED: "warn",
    Status.GIVEN_UP: "warn",
    Status.REJECTED: "bad",
    Status.FALLEN: "bad",
}
WORDS = {
    Status.ACTIVE: "rides to goal {place}",
    Status.REACHED: "goal {place} reached",
    Status.MISSED: "goal {place} missed",
    Status.GIVEN_UP: "goal {place} given up",
    Status.FALLEN: "goal {place} not reached",
    Status.REJECTED: "goal {place} rejected",
    Status.CANCELLED: "goal {place} cancelled",
}


def kind(status: Status) -> str:
    """Return the keyword with which the page draws it."""
    return status.name.lower()


def level(status: Status) -> str:
    """Return good, info, warn or bad."""
    return LEVELS.get(status, "info")


def text(status: Status, place: Point2D, message: str) -> str:
    """Return a description in one line.

    Args:
        status: not one of UNTOLD.
        place: m.
        message: the controller's own line.
    """
    known = all(map(math.isfinite, place))
    where = f"({place[0]:.1f}, {place[1]:.1f})" if known else "without a place"
    line = WORDS[status].format(place=where)
    # The controller's line begins with the same word: "reached after 7.1 s and 19.5 m".
    own = message.removeprefix("reached ") if status is Status.REACHED else message
    joint = " " if status is Status.REACHED and own != message else ": "
    return f"{line}{joint}{own}" if own else line


class NewsFilter:
    """Filter that drops repeated news.

    A path that is sent again makes its first goal active again while the bicycle pursues it; and
    goals that end with the active one, such as 200 waypoints, are not reported one by one.
    """

    def __init__(self) -> None:
        self._active: Point2D | None = None

    def is_new(self, status: Status, place: Point2D) -> bool:
        """Return True if a change is to be reported."""
        if status is Status.REJECTED:
            return True
        is_active = place == self._active
        if status in UNTOLD or (status is Status.CANCELLED and not is_active):
            return False
        self._active = place if status is Status.ACTIVE else None
        return not (status is Status.ACTIVE and is_active)
