"""Direction of arrival in the orientation of a goal's pose."""

from __future__ import annotations

import math

UNTURNED = (0.0, 0.0, 0.0, 1.0)
"""Orientation (x, y, z, w) of a goal that asks for no direction of arrival."""
UNIT_TOLERANCE = 1e-3
"""Largest deviation of a quaternion's length from one."""

Quaternion = tuple[float, float, float, float]


def orientation_of(yaw: float | None) -> Quaternion:
    """Return the orientation (x, y, z, w) of a goal; None asks for no direction."""
    if yaw is None:
        return UNTURNED
    turned = (0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))
    # Exactly UNTURNED asks for no direction: a full turn more is east, too.
    return turned if turned[2] != 0.0 else (0.0, 0.0, 0.0, -turned[3])


def yaw_of(orientation: Quaternion) -> float | None:
    """Return the yaw of a goal's orientation, rad; None if it asks for none or is no rotation."""
    x, y, z, w = map(float, orientation)
    if (x, y, z, w) == UNTURNED or not abs(math.hypot(x, y, z, w) - 1.0) <= UNIT_TOLERANCE:
        return None
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
