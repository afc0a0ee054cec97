"""Node that sends goals and follows their progress."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Sequence
from typing import Any

from bicycle_msgs.action import FollowPath
from bicycle_msgs.msg import BicycleState, GoalStatus, PathStatus
from bicycle_msgs.srv import Reset
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from bicycle_common.nodes import topics
from bicycle_common.nodes.diagnostics import entries_of
from bicycle_common.nodes.goal_orders import GoalOrders
from bicycle_common.nodes.topics import Topic, listen
from bicycle_common.types import Point2D
from bicycle_controller.policy.trained_for import UNLIKE

RECORDED = (
    topics.STATE,
    topics.COMMAND,
    topics.TIMING,
    topics.COMMAND_ECHO,
    topics.PUSHED,
    topics.EPISODE,
    topics.GOAL_STATUS,
    topics.HAND_OVER,
    topics.ESTIMATE,
    topics.CONTROLLER_SETUP,
)
"""Topics of a ride that a bag must contain from the beginning."""

RECORDER = "bicycle_recorder"
"""Prefix of recorders' names."""


SERVED = 1.0
"""Longest wait for a controller's action before goals go by topic (s)."""
STILL = 1.0
"""Time without a new step after which a bicycle counts as standing still (s)."""


class RideClient(Node):
    """Sends goals, tracks the bicycle's newest state, and keeps the goals' changes in order.

    Attributes:
        state: newest state; None before the first.
        states_heard: number of states so far, repeated ones included.
        changes: changes of goals not yet taken by the caller, oldest first.
        warnings: the controller's warnings, each line once, oldest first.
        path: newest status of a path that was followed; None before the first.
        policy_judged: True if the controller has reported, since the bicycle rides, if its policy
            was made for it.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.state: BicycleState | None = None
        self.states_heard = 0
        self.changes: deque[GoalStatus] = deque()
        self._goal: Point2D | None = None
        self.warnings: list[str] = []
        self.policy_judged = False
        self.path: PathStatus | None = None
        self._dead: set[bytes] = set()
        self._heard = self._moved = time.monotonic()
        self._orders = GoalOrders(self)
        listen(self, topics.STATE, self._on_state, depth=1)
        listen(self, topics.GOAL_STATUS, self._on_goal_status)
        listen(self, topics.PATH_STATUS, self._on_path)
        listen(self, topics.DIAGNOSTICS, self._on_diagnostics)
        follow = topics.FOLLOW_PATH_ACTION
        self._follow = ActionClient(self, follow.type, follow.name)
        self._reset = self.create_client(topics.RESET.type, topics.RESET.name)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self)

    def _on_state(self, message: BicycleState) -> None:
        before, self.state = self.state, message
        self.states_heard += 1
        self._heard = time.monotonic()
        if before is None or (before.episode, before.step) != (message.episode, message.step):
            self._moved = self._heard

    def _on_goal_status(self, change: GoalStatus) -> None:
        self.changes.append(change)
        if change.status == GoalStatus.ACTIVE:
            self._goal = change.position.x, change.position.y
        elif change.status != GoalStatus.QUEUED:
            self._goal = None

    def _on_path(self, status: PathStatus) -> None:
        self.path = status

    def follow(self, course: str, laps: int, speed: float) -> bool:
        """Order a course, by name or file; return True if the controller took the order.

        Args:
            course: a name, or a file that the controller can read.
            laps: of a loop; zero takes the course's.
            speed: m/s; zero takes the course's.
        """
        if not self._follow.server_is_ready():
            return False
        self.path = None
        goal = FollowPath.Goal(course=course, laps=int(laps), speed=float(speed))
        self._follow.send_goal_async(goal)
        return True

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        for status in entries_of(self.get_namespace(), array):
            for item in status.values:
                ridden = self.state is not None and self.state.step > 0
                self.policy_judged |= item.key == UNLIKE and ridden
                is_warning = item.key == UNLIKE and item.value != "no"
                if is_warning and item.value not in self.warnings:
                    self.warnings.append(item.value)

    def silence(self) -> float:
        """Return the time since the last state, or since the node's creation, s."""
        return time.monotonic() - self._heard

    def condition(self) -> str:
        """Return the bicycle's condition as text for the user."""
        if self.state is None or self.silence() > STILL:
            return f"no state has come for {self.silence():.0f} s"
        if self.state.fallen:
            return "the bicycle lies"
        if time.monotonic() - self._moved > STILL:
            return "the bicycle stands still: is it paused?"
        return "the bicycle rides on"

    def spin(self, timeout: float = 0.05) -> None:
        """Process received messages, waiting at most `timeout` seconds for them."""
        self._executor.spin_once(timeout_sec=timeout)

    def close(self) -> None:
        """Leave the graph."""
        self._follow.destroy()
        self._orders.close()
        self._executor.shutdown()
        self.destroy_node()

    @property
    def time(self) -> float:
        """Simulated time of the newest state, s."""
        if self.state is None:
            return 0.0
        stamp = self.state.header.stamp
        return float(stamp.sec + 1e-9 * stamp.nanosec)

    def progress_text(self) -> str:
        """Return the distance left, speed and lean, for a progress bar."""
        state = self.state
        if state is None:
            return "no state yet"
        left = ""
        if self._goal is not None:
            x, y = state.rear_contact.x, state.rear_contact.y
            left = f"{math.hypot(self._goal[0] - x, self._goal[1] - y):.1f} m left, "
        lean = math.degrees(state.lean_angle)
        return f"{left}{state.speed:.2f} m/s, lean {lean:+.1f}°"

    def others(self) -> list[str]:
        """Return the names of nodes that simulate or command a bicycle of this name."""
        both = (topics.STATE, topics.COMMAND)
        found = [self.get_publishers_info_by_topic(self._full(topic)) for topic in both]
        return sorted({str(end.node_name) for ends in found for end in ends})

    def controller_listens(self) -> bool:
        """Return True if a living controller takes goals and answers states."""
        alive = self._controllers() - self._dead
        return bool(alive) and self.count_publishers(topics.COMMAND.name) > 0

    def controller_died(self) -> None:
        """Ignore the current subscribers to goals: a killed one stays listed for seconds."""
        self._dead = self._controllers()

    def recorder_listens(self, name: str) -> bool:
        """Return True if a recorder of that name subscribes to all topics that a bag needs."""
        return all(
            name in self._names(self.get_subscriptions_info_by_topic(self._full(topic)))
            for topic in RECORDED
            if self.count_publishers(topic.name)
        )

    def send(self, goals: Sequence[Point2D], yaw: float | None = None) -> None:
        """Order one goal, or several in order, in place of all older ones.

        Args:
            goals: m.
            yaw: rad, direction of arrival at the last goal; None asks for none.
        """
        deadline = time.monotonic() + SERVED
        while not self._orders.served and time.monotonic() < deadline:
            self.spin()
        self._orders.send(goals, yaw)

    def reset(self, timeout: float = 5.0) -> bool:
        """Ask the simulator for a new episode at the origin; return True if it complied."""
        if not self._reset.wait_for_service(timeout_sec=timeout):
            return False
        request = Reset.Request(speed=-1.0, seed=-1)
        future = self._reset.call_async(request)
        self._executor.spin_until_future_complete(future, timeout_sec=timeout)
        answer = future.result() if future.done() else None
        return bool(answer is not None and answer.success)

    def _controllers(self) -> set[bytes]:
        """Return the ids of the subscriptions to goals, except recorders'."""
        found = self.get_subscriptions_info_by_topic(self._full(topics.GOAL_PATH))
        return {bytes(end.endpoint_gid) for end in found if not end.node_name.startswith(RECORDER)}

    def _full(self, topic: Topic) -> str:
        return str(self.resolve_topic_name(topic.name))

    @staticmethod
    def _names(endpoints: Sequence[Any]) -> list[str]:
        return [str(endpoint.node_name) for endpoint in endpoints]
