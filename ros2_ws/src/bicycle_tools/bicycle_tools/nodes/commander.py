"""Rides from Python, in the manner of Nav2's simple commander.

A square, with a bicycle and its controller running:

    from bicycle_tools.nodes.commander import BicycleCommander

    with BicycleCommander() as bicycle:
        for x, y in [(30, 0), (30, 30), (0, 30), (0, 0)]:
            bicycle.ride_to(x, y)
            result = bicycle.wait(lambda feedback: print(f"{feedback.distance:.1f} m left"))
            if not result.reached:
                raise SystemExit(result.message)
        bicycle.follow_course("slalom")
        print(bicycle.wait().message)
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any

import rclpy
from action_msgs.msg import GoalStatus as ActionStatus
from bicycle_msgs.action import FollowPath
from nav_msgs.msg import Path
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from bicycle_common.nodes import topics
from bicycle_common.nodes.goal_orders import to_order, to_pose
from bicycle_common.nodes.topics import ODOM_FRAME
from bicycle_common.types import Point2D

READY = 10.0
"""Longest wait for a controller (s)."""


class CommanderError(Exception):
    """Reason why an order cannot be given; one line with the remedy."""


@dataclass(frozen=True)
class Outcome:
    """End of an order."""

    reached: bool
    """True if the goal was reached, or the path ridden to its end."""
    cancelled: bool
    message: str
    """Description for people, in one line."""
    result: Any
    """The action's own result."""


class BicycleCommander:
    """Gives one bicycle orders by actions, one at a time, and waits for their end.

    Attributes:
        feedback: the newest feedback of the order; None before the first.
    """

    def __init__(self, namespace: str = "", context: Context | None = None) -> None:
        """Make a node.

        Args:
            namespace: of the bicycle, as `/b1`.
            context: of rclpy; its own by default.
        """
        self._own = context is None
        self._context = context or Context()
        if self._own:
            rclpy.init(args=[], context=self._context)
        self._node = Node("bicycle_commander", namespace=namespace, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        actions = topics.RIDE_TO_POSE, topics.FOLLOW_PATH_ACTION
        self._clients = {one: ActionClient(self._node, one.type, one.name) for one in actions}
        self._handle: Any = None
        self._result: Any = None
        self.feedback: Any = None

    def __enter__(self) -> BicycleCommander:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the graph; the bicycle rides on."""
        for client in self._clients.values():
            client.destroy()
        self._executor.shutdown()
        self._node.destroy_node()
        if self._own:
            self._context.try_shutdown()

    def ride_to(self, x: float, y: float, yaw: float | None = None, timeout: float = 0.0) -> None:
        """Order a ride to a place, m, and to arrive in a direction, rad, if one is given.

        Args:
            x: m.
            y: m.
            yaw: rad; None for any.
            timeout: s of simulated time after which it is given up; 0 takes the controller's.

        Raises:
            CommanderError: if nobody takes the order.
        """
        self._send(topics.RIDE_TO_POSE, to_order([(x, y)], yaw, timeout))

    def ride_through(self, points: Sequence[Point2D], yaw: float | None = None) -> None:
        """Order a ride to places, m, in order, and to arrive in a direction, rad, at the last.

        Raises:
            CommanderError: if nobody takes the order, or no place is given.
        """
        if not points:
            raise CommanderError("no place is given: give at least one")
        self._send(topics.RIDE_TO_POSE, to_order(points, yaw))

    def follow_course(self, course: str, laps: int = 0, speed: float = 0.0) -> None:
        """Order a course by its name, or by a file that the controller can read.

        Raises:
            CommanderError: if nobody takes the order.
        """
        goal = FollowPath.Goal(course=course, laps=int(laps), speed=float(speed))
        self._send(topics.FOLLOW_PATH_ACTION, goal)

    def follow_path(
        self, points: Sequence[Point2D], laps: int = 0, speed: float = 0.0, noise: float = 0.0
    ) -> None:
        """Order a path through points, m.

        Raises:
            CommanderError: if nobody takes the order.
        """
        path = Path(poses=[to_pose(point) for point in points])
        path.header.frame_id = ODOM_FRAME
        goal = FollowPath.Goal(path=path, laps=int(laps), speed=float(speed), noise=float(noise))
        self._send(topics.FOLLOW_PATH_ACTION, goal)

    def cancel(self) -> None:
        """Ask for the end of the order; `wait` tells when it has ended."""
        if self._handle is not None:
            self._handle.cancel_goal_async()

    @property
    def done(self) -> bool:
        """True if the order has ended, or none was given."""
        self._executor.spin_once(timeout_sec=0.0)
        return self._result is None or bool(self._result.done())

    def wait(
        self, told: Callable[[Any], None] | None = None, timeout: float = math.inf
    ) -> Outcome:
        """Wait for the end of the order.

        Args:
            told: called with every feedback.
            timeout: s by the clock.

        Raises:
            CommanderError: if there is none, or it takes too long.
        """
        if self._result is None:
            raise CommanderError("no order was given: call ride_to, follow_course or follow_path")
        deadline, seen = time.monotonic() + timeout, None
        while not self._result.done():
            self._executor.spin_once(timeout_sec=0.1)
            if told is not None and self.feedback is not None and self.feedback is not seen:
                seen = self.feedback
                told(seen)
            if time.monotonic() > deadline:
                raise CommanderError(f"not done within {timeout:g} s")
        answer = self._result.result()
        good = answer.status == ActionStatus.STATUS_SUCCEEDED
        gone = answer.status == ActionStatus.STATUS_CANCELED
        return Outcome(good, gone, answer.result.message, answer.result)

    def _send(self, action: topics.Action, goal: Any) -> None:
        self._handle = self._result = None  # a failed order must not stand for the one before
        client = self._clients[action]
        deadline = time.monotonic() + READY
        while not client.server_is_ready():
            self._executor.spin_once(timeout_sec=0.1)
            if time.monotonic() > deadline:
                name = self._node.resolve_service_name(action.name)
                raise CommanderError(f"nobody serves {name} within {READY:g} s: controller.sh")
        self.feedback = None

        def hear(message: Any) -> None:
            self.feedback = message.feedback

        sent = client.send_goal_async(goal, feedback_callback=hear)
        self._spin(sent)
        self._handle = sent.result()
        if not self._handle.accepted:
            raise CommanderError("the controller took no order")
        self._result = self._handle.get_result_async()

    def _spin(self, future: Any) -> None:
        deadline = time.monotonic() + READY
        while not future.done():
            self._executor.spin_once(timeout_sec=0.1)
            if time.monotonic() > deadline:
                raise CommanderError(f"no answer within {READY:g} s: see the controller's log")
