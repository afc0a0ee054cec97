"""Orders to ride to goals: by action where a controller serves it, else on the goal topics."""

from __future__ import annotations

from collections.abc import Sequence

from bicycle_msgs.action import RideToPose
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.action import ActionClient
from rclpy.node import Node

from bicycle_common.nodes import convert, topics
from bicycle_common.nodes.topics import advertise
from bicycle_common.types import Point2D


class GoalOrders:
    """Sends goals of one node; what becomes of them is told on `bicycle/goal_status`."""

    def __init__(self, node: Node) -> None:
        """Make the action's client and the topics' publishers on `node`."""
        action = topics.RIDE_TO_POSE
        self._client = ActionClient(node, action.type, action.name)
        self._publishers = advertise(node, topics.GOAL_POSE, topics.GOAL_PATH)

    @property
    def served(self) -> bool:
        """True if a controller that serves the action is connected."""
        return bool(self._client.server_is_ready())

    def send(self, goals: Sequence[Point2D], yaw: float | None = None) -> bool:
        """Order goals in place of all older ones; none clears them.

        Args:
            goals: m, ridden to in order.
            yaw: rad, direction of arrival at the last one; None asks for none.

        Returns:
            True if the action was used. Clearing always goes by topic: it ends goals of others.
        """
        if goals and self.served:
            self._client.send_goal_async(to_order(goals, yaw))
            return True
        self._publish(goals, yaw)
        return False

    def _publish(self, goals: Sequence[Point2D], yaw: float | None) -> None:
        poses = [to_pose(goal) for goal in goals]
        if yaw is not None and poses:
            poses[-1].pose.orientation = convert.to_arrival(yaw)
        if len(poses) == 1:
            self._publishers[topics.GOAL_POSE.name].publish(poses[0])
            return
        path = Path(poses=poses)
        path.header.frame_id = topics.ODOM_FRAME
        self._publishers[topics.GOAL_PATH.name].publish(path)

    def close(self) -> None:
        """Leave the action."""
        self._client.destroy()


def to_order(
    goals: Sequence[Point2D], yaw: float | None = None, timeout: float = 0.0
) -> RideToPose.Goal:
    """Return the action's goal: one or more places, m, and a direction of arrival, rad."""
    poses = [to_pose(goal) for goal in goals]
    order = RideToPose.Goal(pose=poses[-1], through=poses[:-1], timeout=float(timeout))
    if yaw is not None:
        order.use_heading = True
        order.pose.pose.orientation = convert.to_quaternion(yaw)
    return order


def to_pose(goal: Point2D) -> PoseStamped:
    """Return a goal, m, as RViz sends it, without a direction of arrival."""
    pose = PoseStamped()
    pose.header.frame_id = topics.ODOM_FRAME
    pose.pose.position = convert.to_point(goal)
    pose.pose.orientation.w = 1.0
    return pose
