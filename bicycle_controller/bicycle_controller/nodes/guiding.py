"""Topics of the guides: paths and cmd_vel in, the followed path and its status out."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from typing import Any

from bicycle_msgs.msg import PathStatus
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from nav_msgs.msg import Path as PathMessage
from rclpy.node import Node

from bicycle_common.geometry import heading_to_yaw
from bicycle_common.nodes import convert, topics
from bicycle_common.nodes.topics import BASE_FRAME, ODOM_FRAME, Topic, listen
from bicycle_common.types import BicycleState, Point2D
from bicycle_controller.control import courses
from bicycle_controller.control.courses import Course
from bicycle_controller.control.guidance import Guidance, MakeCourse, unridden
from bicycle_controller.control.guide import PathEnd, PathReport
from bicycle_controller.control.path import Path
from bicycle_controller.control.path_making import Rounding, path_through
from bicycle_controller.nodes.neighbours import Neighbours
from bicycle_sim.nodes.robot_model import frames_of

MOST_SHOWN = 2000
"""Largest number of poses of a published path."""
INACTIVE = "the controller is not active: ros2 lifecycle set it active"
"""Reason why an order is refused."""
QUIET = 5.0
"""s between two warnings of a cmd_vel that is ignored."""


class Guiding:
    """Connects `Guidance` to its topics; the controller's node calls it."""

    def __init__(
        self,
        node: Node,
        guidance: Guidance,
        publish: Callable[[Topic, Any], None],
        in_use: threading.Lock,
        active: Callable[[], bool],
        state_time: Callable[[], float],
        others: Sequence[str] = (),
    ) -> None:
        """Subscribe.

        Args:
            node: the controller's node.
            guidance: of its loop.
            publish: of the node.
            in_use: held by who uses the loop.
            active: whether the node takes orders.
            state_time: simulated time of the newest state, s.
            others: namespaces of the bicycles to keep clear of.
        """
        self.guidance = guidance
        self._node, self._publish = node, publish
        self._in_use, self._active, self._state_time = in_use, active, state_time
        prefix = frames_of(node.get_namespace())
        self._frame, self._own_frames = prefix + ODOM_FRAME, ("", BASE_FRAME, prefix + BASE_FRAME)
        self.on_report: Callable[[PathReport], None] = lambda report: None
        listen(node, topics.FOLLOW_PATH, self._on_path)
        listen(node, topics.CMD_VEL, self._on_twist_stamped)
        listen(node, topics.CMD_VEL_PLAIN, self._on_twist)
        guidance.name = node.get_namespace().strip("/")
        self._neighbours = Neighbours(node, others, guidance.others)

    @property
    def unheard(self) -> list[str]:
        """Names of the bicycles to keep clear of without a received state."""
        return self._neighbours.unheard

    def close(self) -> None:
        """Stop watching the other bicycles."""
        self._neighbours.close()

    def _on_path(self, message: PathMessage) -> None:
        try:
            if not self._active():
                raise ValueError(INACTIVE)
            points = to_points(message)
        except ValueError as error:
            self._node.get_logger().warning(f"path rejected: {error}")
            # At once: without a state no other report would take it along.
            report = unridden(0, "", PathEnd.REJECTED, str(error))
            self._publish(topics.PATH_STATUS, from_report(report, self._now(), self._frame))
            return
        with self._in_use:
            self.guidance.follow("", course_of(points, self.guidance.config.speed))

    def _on_twist_stamped(self, message: TwistStamped) -> None:
        stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
        frame, late = message.header.frame_id, self._age(stamp)
        if frame not in self._own_frames:
            self._ignore(f"its frame is {frame!r}: send it in {self._own_frames[-1]!r} or in none")
        elif late > self.guidance.config.twist.timeout:
            self._ignore(f"it is {late:.1f} s old, more than cmd_vel_timeout: are the clocks one?")
        else:
            self._on_twist(message.twist)

    def _on_twist(self, message: Twist) -> None:
        try:
            if not self._active():
                raise ValueError(INACTIVE)
            with self._in_use:
                self.guidance.twist(float(message.linear.x), float(message.angular.z))
        except ValueError as error:
            self._ignore(str(error))

    def _ignore(self, why: str) -> None:
        """Tell that a command is ignored, which may go on for long."""
        text = f"cmd_vel ignored: {why}"
        self._node.get_logger().warning(text, throttle_duration_sec=QUIET)

    def _age(self, stamp: float) -> float:
        """Return how old a stamp is, s; zero without one.

        A sender's clock is the computer's or the simulator's: the nearer one counts.
        """
        if stamp == 0.0:
            return 0.0
        return min((self._now() * 1e-9 - stamp, self._state_time() - stamp), key=abs)

    def _now(self) -> int:
        """Return the node's time, ns."""
        return int(self._node.get_clock().now().nanoseconds)

    def after_state(self, snapshot: BicycleState) -> None:
        """Publish the guides' new reports."""
        guidance = self.guidance
        now = self._now()
        path, guidance.followed = guidance.followed, None
        if path is not None:
            self._publish(topics.FOLLOWED_PATH, to_message(path, now, self._frame))
        for report in guidance.reports():
            self.on_report(report)
            self._publish(topics.PATH_STATUS, from_report(report, now, self._frame))
        lines, guidance.log_lines = guidance.log_lines, []
        for line in lines:
            self._node.get_logger().info(line)


def course_of(points: list[Point2D], speed: float, noise: float = 0.0) -> MakeCourse:
    """Return a function that makes the course of points."""

    def make(radius: float) -> Course:
        rounding = Rounding(tightest=radius, widest=max(radius, 6.0))
        return Course("", path_through(points, rounding=rounding, noise=noise), speed)

    return make


def course_named(name: str) -> MakeCourse:
    """Return a function that loads a course."""
    return lambda radius: courses.load(name, radius)


def to_points(message: PathMessage, frame: str = "") -> list[Point2D]:
    """Return the points of a path message, m; `frame` is that of points that name none.

    Raises:
        ValueError: on a frame or a number that cannot be, or too many points.
    """
    most = 200_000
    if len(message.poses) > most:
        raise ValueError(f"{len(message.poses)} points are more than {most}")
    frame = message.header.frame_id or frame
    return [
        convert.to_goal(pose.header.frame_id or frame, pose.pose.position)
        for pose in message.poses
    ]


def to_message(path: Path, nanoseconds: int, frame: str = ODOM_FRAME) -> PathMessage:
    """Return a path as it is followed, with its headings; every n-th sample of a long one."""
    header = convert.to_header(nanoseconds, frame)
    message = PathMessage(header=header)
    every = max(1, math.ceil(len(path.x) / MOST_SHOWN))
    chosen = [*range(0, len(path.x) - 1, every), len(path.x) - 1]
    for index in chosen:
        pose = PoseStamped(header=header)
        pose.pose.position = convert.to_point((float(path.x[index]), float(path.y[index])))
        yaw = float(heading_to_yaw(path.heading[index]))
        pose.pose.orientation = convert.to_quaternion(yaw)
        message.poses.append(pose)
    return message


def from_report(report: PathReport, nanoseconds: int, frame: str = ODOM_FRAME) -> PathStatus:
    """Return the status message of a path."""
    return PathStatus(
        header=convert.to_header(nanoseconds, frame),
        path_id=int(report.path_id),
        name=report.name,
        status=int(report.status),
        lap=int(report.lap),
        laps=int(report.laps),
        message=report.message,
        **{
            name: float(getattr(report, name))
            for name in (
                "along",
                "length",
                "cross_track",
                "heading_error",
                "wanted_speed",
                "rms",
                "largest",
                "elapsed",
            )
        },
    )
