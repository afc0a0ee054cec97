"""Orders by Nav2's actions, as a program of Nav2 would; prints what came of each."""

from __future__ import annotations

import importlib
import math
import sys
from typing import Any

import rclpy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.action import ActionClient
from rclpy.node import Node


def pose(x: float, y: float, yaw: float = 0.0) -> PoseStamped:
    pose = PoseStamped()
    pose.header.frame_id = "map"
    pose.pose.position.x, pose.pose.position.y = x, y
    pose.pose.orientation.z, pose.pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return pose


def order(node: Node, kind: Any, name: str, goal: Any) -> str:
    """Send one goal and wait; return its name, status, error code, and the last feedback."""
    client = ActionClient(node, kind, name)
    assert client.wait_for_server(60.0)
    heard: list[Any] = []
    sent = client.send_goal_async(goal, lambda message: heard.append(message.feedback))
    rclpy.spin_until_future_complete(node, sent)
    found = sent.result().get_result_async()
    rclpy.spin_until_future_complete(node, found)
    answer = found.result()
    last: Any = heard[-1] if heard else None
    left = getattr(last, "distance_remaining", getattr(last, "distance_to_goal", math.nan))
    if last is not None and hasattr(last, "current_pose"):
        turn = last.current_pose.pose.orientation
        print(f"yaw {2.0 * math.atan2(turn.z, turn.w):.2f}")
    client.destroy()
    return f"{name}: {answer.status} {answer.result.error_code} {left:.1f} {len(heard)}"


def main() -> None:
    """Ride to a pose, through poses, and along a path; then ask for what cannot be ridden."""
    actions = importlib.import_module("nav2_msgs.action")
    rclpy.init(args=sys.argv)
    node = Node("nav2_client")
    to = actions.NavigateToPose.Goal(pose=pose(30.0, 5.0, math.pi / 2))
    print(order(node, actions.NavigateToPose, "navigate_to_pose", to))
    poses = [pose(30.0, 40.0), pose(0.0, 50.0, math.pi)]
    through = actions.NavigateThroughPoses.Goal(poses=poses)
    print(order(node, actions.NavigateThroughPoses, "navigate_through_poses", through))
    path = Path(poses=[pose(0.0, 50.0), pose(-20.0, 50.0), pose(-40.0, 40.0)])
    path.header.frame_id = "map"
    follow = actions.FollowPath.Goal(path=path, controller_id="FollowPath")
    print(order(node, actions.FollowPath, "follow_path", follow))
    path = Path(poses=[pose(0.0, 0.0), pose(50.0, 0.0), pose(5.0, 0.0)])
    path.header.frame_id = "map"
    follow = actions.FollowPath.Goal(path=path)
    print(order(node, actions.FollowPath, "follow_path", follow))
    strange = pose(0.0, 0.0)
    strange.header.frame_id = "mars"
    to = actions.NavigateToPose.Goal(pose=strange)
    print(order(node, actions.NavigateToPose, "navigate_to_pose", to))
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
