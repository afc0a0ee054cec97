"""Waypoints that make a bicycle reach a goal in a given direction.

The controller aims at points and knows no direction of arrival. A point before the goal, on the
line of arrival, defines one; if the bicycle comes from ahead, a farther point leaves it room to
turn round.
"""

from __future__ import annotations

import math

import numpy as np

from bicycle_common.geometry import wrap_angle
from bicycle_common.types import Point2D
from bicycle_controller.control.dubins import Pose2D, points, shortest
from bicycle_controller.control.path import Path, sampled

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


def arrival_path(start: Pose2D, end: Pose2D, radius: float, run_in: float = 4.0) -> Path:
    """Return a path on which a bicycle arrives in a direction.

    Args:
        start: where it is; yaw, rad.
        end: where it is to arrive, and its yaw there.
        radius: m that it turns with at least.
        run_in: m of straight before the goal, which calm it, and as much again behind it.
    """
    x, y, yaw = end
    c, s = math.cos(yaw), math.sin(yaw)
    before = (x - run_in * c, y - run_in * s, yaw)
    segments = shortest(start, before, radius)
    segments.append(("S", 2.0 * run_in))
    return sampled(*points(start, segments, radius))


def circle_path(centre: Point2D, radius: float, bicycle: Point2D, left: bool = True) -> Path:
    """Return a loop around a point, which begins where the bicycle is nearest to it, m."""
    begin = math.atan2(bicycle[1] - centre[1], bicycle[0] - centre[0])
    side = 1.0 if left else -1.0
    angle = begin + side * np.linspace(0.0, 2.0 * math.pi, max(200, round(400.0 * radius)))
    x, y = centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)
    x[-1], y[-1] = x[0], y[0]
    return sampled(x, y, closed=True)
