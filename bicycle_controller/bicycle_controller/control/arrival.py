"""Points to ride by so that a goal is reached in a given direction.

The controller aims at points and knows no direction of arrival. A point before the goal, on the
line that is to be ridden, gives one; where the bicycle comes from ahead, a farther one leaves
it the room to turn round.
"""

from __future__ import annotations

import math

from bicycle_common.geometry import wrap_angle
from bicycle_common.types import Point2D

LEAD = 14.0
"""m from the goal back to the last point before it."""
RUN_UP = 2.2 * LEAD
"""m from the goal back to the point from which the line is taken up."""
STRAIGHT = math.radians(50.0)
"""The near point alone will do when it is seen within this of the wanted direction."""


def approach(goal: Point2D, heading: float, bicycle: Point2D) -> list[Point2D]:
    """The points to ride to, in order; the goal is the last.

    Args:
        goal: m.
        heading: rad, yaw in which to arrive.
        bicycle: m, where it is now.
    """
    near, far = _before(goal, heading, LEAD), _before(goal, heading, RUN_UP)
    dx, dy = near[0] - bicycle[0], near[1] - bicycle[1]
    off = abs(float(wrap_angle(math.atan2(dy, dx) - heading)))
    if math.hypot(dx, dy) >= LEAD and off <= STRAIGHT:
        return [near, goal]
    return [far, near, goal]


def _before(goal: Point2D, heading: float, distance: float) -> Point2D:
    return goal[0] - distance * math.cos(heading), goal[1] - distance * math.sin(heading)
