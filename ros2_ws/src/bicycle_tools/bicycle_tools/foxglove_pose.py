"""Poses in JSON, as Foxglove's panels publish them, checked before they become messages."""

from __future__ import annotations

import json
import math
from typing import Any, NamedTuple

MOST_BYTES = 4096
"""Largest size of a pose (bytes): one with a covariance has about 1500."""


class ClientPose(NamedTuple):
    """Pose from a client: frame, position in m, orientation as a quaternion."""

    frame: str
    position: tuple[float, float, float]
    orientation: tuple[float, float, float, float]


def parse_pose(data: bytes) -> ClientPose:
    """Read a geometry_msgs PoseStamped, or PoseWithCovarianceStamped, in JSON.

    The stamp is ignored, because ROS 1, ROS 2 and Foxglove name its fields differently and nothing
    needs it; so is the covariance, because the simulated ground truth has none.

    Raises:
        ValueError: if it is not one, or a number is not finite; the text is one line.
    """
    if len(data) > MOST_BYTES:
        raise ValueError(f"it has {len(data)} bytes, more than a pose needs ({MOST_BYTES})")
    try:
        message = json.loads(data)
    except (ValueError, RecursionError):
        raise ValueError("it is not JSON") from None
    pose = _part(message, "pose")
    pose = pose.get("pose", pose)
    position, orientation = _part(pose, "position"), pose.get("orientation", {"w": 1.0})
    if not isinstance(orientation, dict):
        raise ValueError("its orientation is not an object")
    frame = _part(message, "header").get("frame_id", "")
    if not isinstance(frame, str):
        raise ValueError("its header.frame_id is not a text")
    x, y, z = (_number(position, name, 0.0 if name == "z" else None) for name in "xyz")
    a, b, c, w = (_number(orientation, name, 0.0) for name in "xyzw")
    return ClientPose(frame, (x, y, z), (a, b, c, w))


def _part(message: Any, name: str) -> dict[str, Any]:
    part = message.get(name) if isinstance(message, dict) else None
    if not isinstance(part, dict):
        raise ValueError(f"it has no {name}: send a geometry_msgs/PoseStamped")
    return part


def _number(part: dict[str, Any], name: str, default: float | None) -> float:
    value = part.get(name, default)
    try:
        number = float(value) if isinstance(value, (int, float)) else math.nan
    except OverflowError:
        number = math.inf
    if isinstance(value, bool) or not math.isfinite(number):
        raise ValueError(f"its {name} is {str(value)[:40]!r}: send finite numbers")
    return number
