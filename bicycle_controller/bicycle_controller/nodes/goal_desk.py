"""Goals of topics and actions become orders, and the goals' events become messages."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from bicycle_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.node import Node
from std_msgs.msg import Header

from bicycle_common.arrival import UNTURNED
from bicycle_common.nodes import convert, topics
from bicycle_common.nodes.topics import ODOM_FRAME, Topic, listen
from bicycle_common.types import Point2D
from bicycle_controller.control.courses import FASTEST, MOST_LAPS
from bicycle_controller.control.goals import Event, GoalTracker, Status
from bicycle_controller.control.guidance import Guidance
from bicycle_controller.nodes.controller_settings import ControllerSettings
from bicycle_controller.nodes.guiding import INACTIVE, course_named, course_of, to_points
from bicycle_controller.nodes.messages import from_event, goal_marker
from bicycle_sim.nodes.robot_model import frames_of

MOST_WAYPOINTS = 10_000
CANCELLED = "cancelled by the client of the action"
"""Reason of a goal's or a path's end."""
WRONG_WAY = 10.0
"""Degrees off the asked direction of arrival from which on it is told."""


class GoalDesk:
    """Takes goals, paths and cancellations of one bicycle, and publishes what becomes of goals.

    Goals come by topic, or by action in another thread; both are the same order.
    """

    def __init__(
        self,
        node: Node,
        guidance: Guidance,
        tracker: GoalTracker,
        in_use: threading.Lock,
        publish: Callable[[Topic, Any], None],
        settings: Callable[[], ControllerSettings],
        active: Callable[[], bool],
    ) -> None:
        """Take orders of actions; topics are heard from `listen` on.

        Args:
            node: the controller's node.
            guidance: of its loop.
            tracker: the loop's goals.
            in_use: held by who uses the loop.
            publish: of the node.
            settings: the node's present ones.
            active: whether the node takes orders.
        """
        self._node, self._guidance, self._tracker = node, guidance, tracker
        self._in_use, self._publish = in_use, publish
        self._settings, self._active = settings, active
        self._prefix = frames_of(node.get_namespace())
        self._asked = 0, math.nan

    def listen(self) -> None:
        """Subscribe to the topics of goals."""
        listen(self._node, topics.GOAL_POSE, self._on_goal_pose)
        listen(self._node, topics.GOAL_PATH, self._on_goal_path)

    def ride(self, poses: list[PoseStamped], use_heading: bool) -> tuple[list[int], str]:
        """Take an action's goals; see `_replace`."""
        found = self._replace(poses, poses[0].header.frame_id, use_heading)
        self._publish(topics.ORDERED_GOALS, Path(header=self._header(), poses=poses))
        return found

    def follow(self, path: Path, course: str, laps: int, speed: float, noise: float) -> int:
        """Follow a path, or the course of a name, instead of all goals and paths before.

        Args:
            path: its points; empty if a course is given.
            course: name of a course, or empty.
            laps: number of laps; 0 is the course's own.
            speed: m/s; 0 is the course's own.
            noise: m, standard deviation of the path's points.

        Returns:
            The path's number.

        Raises:
            ValueError: if it cannot be followed.
        """
        if not self._active():
            raise ValueError(INACTIVE)
        if bool(course) == bool(path.poses):
            raise ValueError("give either a path or a course")
        good = all(math.isfinite(value) and value >= 0.0 for value in (speed, noise))
        if not good or speed > FASTEST or noise > 100.0 or laps > MOST_LAPS:
            raise ValueError(
                f"speed must be 0 to {FASTEST:g} m/s, noise 0 to 100 m, laps 0 to {MOST_LAPS}"
            )
        make = (
            course_named(course)
            if course
            else course_of(to_points(path), self._settings().path_speed, noise)
        )
        with self._in_use:
            return self._guidance.follow(course, make, laps, speed)

    def cancel(self, path_id: int = 0) -> None:
        """Cancel an action's path of that number, or with zero its goals."""
        with self._in_use:
            self._guidance.cancel(path_id, CANCELLED)
            if not path_id:
                self._tracker.cancel(CANCELLED)

    def judge(self, event: Event) -> Event:
        """Return a goal's event; if it was reached in a wrong direction, its message says so."""
        goal_id, yaw = self._asked
        if event.status is not Status.REACHED or event.goal.goal_id != goal_id:
            return event
        off = abs(math.degrees(self._guidance.off(yaw)))
        if not off > WRONG_WAY:
            return event
        text = f"{event.message}; arrived {off:.0f} degrees off the asked heading"
        return replace(event, message=text)

    def report(self, event: Event) -> None:
        """Publish a goal's new status, and do what follows the last goal."""
        header = self._header()
        message = from_event(event, header)
        self._publish(topics.GOAL_STATUS, message)
        if event.status is Status.ACTIVE:
            pose = PoseStamped(header=header)
            pose.pose.position = message.position
            with self._in_use:
                yaw = self._guidance.arrival_at(event.goal.point)
            pose.pose.orientation = convert.to_arrival(yaw)
            self._publish(topics.ACTIVE_GOAL, pose)
        if event.status is not Status.QUEUED:
            active = self._tracker.active
            goal = active.point if active else None
            marker = goal_marker(goal, self._tracker.radius, self._prefix)
            self._publish(topics.GOAL_MARKER, marker)
        x, y = event.goal.point
        name = event.status.name.lower().replace("_", " ")
        self._log(f"goal {event.goal.goal_id} ({x:g}, {y:g}) {name}: {event.message}")
        last = not (self._tracker.has_goal or event.remaining)
        if last and event.status is Status.REACHED:
            with self._in_use:
                told = self._guidance.after_goal(event.goal.point)
            if told:
                self._log(f"after goal {event.goal.goal_id}: {told}")

    def _on_goal_pose(self, message: PoseStamped) -> None:
        turn = message.pose.orientation
        turned = (turn.x, turn.y, turn.z, turn.w) != UNTURNED
        use_heading = turned and self._settings().arrival == "heading"
        self._take([message], message.header.frame_id, use_heading)

    def _on_goal_path(self, message: Path) -> None:
        self._take(message.poses, message.header.frame_id, False)

    def _take(self, poses: list[PoseStamped], frame: str, use_heading: bool) -> None:
        """Pursue goals of a topic, or refuse all of them."""
        with contextlib.suppress(ValueError):  # the status tells it
            self._replace(poses, frame, use_heading)

    def _replace(
        self, poses: list[PoseStamped], frame: str, use_heading: bool
    ) -> tuple[list[int], str]:
        """Pursue these poses instead of all previous goals, or refuse all of them.

        Returns:
            The goals' numbers, and why the last one is not reached in the direction of its
            orientation, as `use_heading` asks; empty if it is.

        Raises:
            ValueError: if they are refused; the status of the first tells it, too.
        """
        points: list[Point2D] = []
        try:
            if not self._active():
                raise ValueError(INACTIVE)
            if len(poses) > MOST_WAYPOINTS:
                raise ValueError(f"{len(poses)} waypoints are more than {MOST_WAYPOINTS}")
            for pose in poses:
                position = pose.pose.position
                points.append(convert.to_goal(pose.header.frame_id or frame, position))
        except ValueError as error:
            self._node.get_logger().warning(f"goal rejected: {error}")
            self._publish(topics.GOAL_STATUS, self._rejection(poses, str(error)))
            raise
        yaw, why = math.nan, ""
        if use_heading:
            try:
                yaw = convert.to_yaw(poses[-1].pose.orientation)
            except ValueError as error:
                why = str(error)
        with self._in_use:
            self._guidance.stop("a newer goal came")
            ids = [goal.goal_id for goal in self._tracker.replace(points)]
            self._asked = (ids[-1], yaw) if ids else (0, math.nan)
            if math.isfinite(yaw):
                why = self._guidance.arrive(points, yaw)
        if why:
            self._node.get_logger().warning(f"arrives in any direction: {why}")
        return ids, why

    def _rejection(self, poses: list[PoseStamped], why: str) -> GoalStatus:
        first = poses[0].pose.position if poses else None  # an empty path cancels
        return GoalStatus(
            header=self._header(),
            status=GoalStatus.REJECTED,
            position=convert.to_point((first.x, first.y) if first else None),
            distance=math.nan,
            message=why,
        )

    def _header(self) -> Header:
        """Return a header of now, in the bicycle's own frame of a fleet."""
        now = self._node.get_clock().now().nanoseconds
        return convert.to_header(now, self._prefix + ODOM_FRAME)

    def _log(self, line: str) -> None:
        self._node.get_logger().info(line)
