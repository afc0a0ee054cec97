"""Paths on which a bicycle arrives at a goal in a direction, and circles around a goal."""

from __future__ import annotations

import math

import numpy as np

from bicycle_common.types import Point2D
from bicycle_controller.control.dubins import Pose2D, points, shortest
from bicycle_controller.control.path import Path, sampled

RUN_IN = 4.0
"""m of straight before and behind a goal with a direction."""


def arrival_path(start: Pose2D, end: Pose2D, radius: float, run_in: float = RUN_IN) -> Path:
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
