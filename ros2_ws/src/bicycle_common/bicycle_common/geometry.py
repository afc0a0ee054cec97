"""Plane geometry of headings, in the paper's convention.

The heading psi is measured from +y, counter-clockwise, so a bicycle travels along
(-sin psi, cos psi) (errata row 2). Every function takes scalars or arrays of one shape.
"""

from __future__ import annotations

import math
from types import ModuleType
from typing import Any

import numpy as np

Array = Any
"""A numpy array, or a torch tensor if `xp` is torch."""


def wrap_angle(angle: Array, xp: ModuleType = np) -> Array:
    """Return the same direction in (-pi, pi], rad."""
    return angle - 2.0 * math.pi * xp.ceil(angle / (2.0 * math.pi) - 0.5)


def heading_between(
    from_x: Array, from_y: Array, to_x: Array, to_y: Array, xp: ModuleType = np
) -> Array:
    """Return the heading psi of the line from one point to another, rad."""
    return xp.arctan2(from_x - to_x, to_y - from_y)


def heading_error(
    heading: Array, rear_x: Array, rear_y: Array, goal_x: Array, goal_y: Array, xp: ModuleType = np
) -> Array:
    """Return psi_g, rad in (-pi, pi]: positive if the goal lies to the right (errata row 23)."""
    return wrap_angle(heading - heading_between(rear_x, rear_y, goal_x, goal_y, xp), xp)


def heading_to_yaw(heading: Array, xp: ModuleType = np) -> Array:
    """Return the REP-103 yaw (zero along +x) of a heading psi (zero along +y), in (-pi, pi]."""
    return wrap_angle(heading + 0.5 * math.pi, xp)


def yaw_to_heading(yaw: Array, xp: ModuleType = np) -> Array:
    """Return the heading psi of a REP-103 yaw; the inverse of `heading_to_yaw`."""
    return wrap_angle(yaw - 0.5 * math.pi, xp)
