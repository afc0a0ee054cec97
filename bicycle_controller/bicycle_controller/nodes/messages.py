"""Messages about goals and about the active controller."""

from __future__ import annotations

from bicycle_msgs.msg import GoalStatus
from bicycle_msgs.msg import HandOver as HandOverMessage
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker

from bicycle_common.nodes import convert
from bicycle_common.nodes.topics import ODOM_FRAME
from bicycle_common.types import Point2D
from bicycle_controller.control.control_output import ControllerSwitch
from bicycle_controller.control.goals import Event


def from_event(event: Event, header: Header) -> GoalStatus:
    """Return the status message of a goal."""
    return GoalStatus(
        header=header,
        goal_id=int(event.goal.goal_id),
        status=int(event.status),
        position=convert.to_point(event.goal.point),
        distance=float(event.distance),
        elapsed=float(event.elapsed),
        path_length=float(event.path_length),
        remaining=int(event.remaining),
        message=event.message,
    )


def from_hand_over(switch: ControllerSwitch, stamp: Time) -> HandOverMessage:
    """Return the message about a change of the active controller."""
    return HandOverMessage(
        header=Header(stamp=stamp),
        episode=int(switch.episode),
        step=int(switch.step),
        reason=int(switch.reason),
        stop=bool(switch.stop),
        policy=str(switch.policy),
        hand_overs=int(switch.count),
        message=switch.message,
    )


def goal_marker(goal: Point2D | None, radius: float, prefix: str = "") -> Marker:
    """Return a disc of `radius`, m, at the goal; without a goal, its removal.

    Args:
        goal: m.
        radius: m.
        prefix: before the frame, see `robot_model.frames_of`.
    """
    header = convert.to_header(0, prefix + ODOM_FRAME)
    marker = Marker(header=header, ns="goal", type=Marker.CYLINDER)
    marker.pose.orientation.w = 1.0
    if goal is None:
        marker.action = Marker.DELETE
        return marker
    marker.pose.position = convert.to_point(goal)
    marker.scale = Vector3(x=2.0 * radius, y=2.0 * radius, z=0.05)
    marker.color = ColorRGBA(r=0.1, g=0.7, b=0.2, a=0.5)
    return marker
