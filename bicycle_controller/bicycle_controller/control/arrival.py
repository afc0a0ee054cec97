"""Waypoints that make a bicycle reach a goal in a given direction.

The controller aims at points and knows no direction of arrival. A point before the goal, on the
line of arrival, defines one; if the bicycle comes from ahead, a farther point leaves it room to
turn round.
"""

from __future__ import annotations

import math

from bicycle_common.geometry import wrap_angle
from bicycle_common.types import Point2D

LEAD = 14.0
"""Distance from the goal back to the last point before it, m."""
RUN_UP = 2.2 * LEAD
"""Distance from the goal back to the point where the line begins, m."""
STRAIGHT = math.radians(50.0)
"""Largest angle to the wanted direction at which the near point alone suffices, rad."""


def approach(goal: Point2D, heading: float, bicycle: Point2D) -> list[Point2D]:
    """Return the points to ride to, in order; the goal is the last.

    Args:
        goal: m.
        heading: yaw on arrival, rad.
        bicycle: current position, m.
    """
    near, far = _before(goal, heading, LEAD), _before(goal, heading, RUN_UP)
    dx, dy = near[0] - bicycle[0], near[1] - bicycle[1]
    off = abs(float(wrap_angle(math.atan2(dy, dx) - heading)))
    if math.hypot(dx, dy) >= LEAD and off <= STRAIGHT:
        return [near, goal]
    return [far, near, goal]


def _before(goal: Point2D, heading: float, distance: float) -> Point2D:
    return goal[0] - distance * math.cos(heading), goal[1] - distance * math.sin(heading)
