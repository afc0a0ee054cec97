"""Actions of the controller, served on a node and a thread of their own.

`bicycle/ride_to_pose` and `bicycle/follow_path` are this project's; where nav2_msgs is installed,
`navigate_to_pose`, `navigate_through_poses` and `follow_path` are served too. One order is carried
out at a time: a newer one, by action or by topic, ends it as soon as that one is taken. A path
takes a moment to be made and may be refused; until it is taken, the order before it goes on.
"""

from __future__ import annotations

import contextlib
import importlib
import math
import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from bicycle_msgs.action import FollowPath, RideToPose
from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionServer, CancelResponse
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

from bicycle_common.geometry import heading_to_yaw, wrap_angle
from bicycle_common.nodes import convert, topics
from bicycle_common.nodes.topics import ODOM_FRAME
from bicycle_common.types import BicycleState
from bicycle_controller.control.goals import Event, Status
from bicycle_controller.control.guidance import NEWER
from bicycle_controller.control.guide import PathEnd, PathReport
from bicycle_controller.nodes import nav2_errors
from bicycle_sim.nodes.robot_model import frames_of

nav2: Any = None
"""Nav2's actions, where they are installed: no package of this project needs them."""
with contextlib.suppress(ImportError):
    nav2 = importlib.import_module("nav2_msgs.action")

PERIOD = 0.1
"""s between feedbacks, and between looks at events."""
LAST = 1.0
"""Longest wait at the end for the thread (s)."""
RUNNING = (Status.QUEUED, Status.ACTIVE)
RIDDEN = (PathEnd.ACTIVE, PathEnd.FINISHED, PathEnd.LOST, PathEnd.FALLEN)
"""Statuses of a path that was taken."""
LATE = "not reached within"


@dataclass
class Order:
    """One accepted goal of an action."""

    handle: Any
    done: Future
    kind: str
    """pose, poses, path, or one of nav2's of the same ending."""
    ids: list[int]
    """Goals, or the one path."""
    yaw: float = math.nan
    began: float = 0.0
    left: int = 1
    cancelled: bool = False
    patience: int = 50
    """Feedbacks that a cancelled order waits for the controller's word."""
    last: Event | PathReport | None = None
    reason: str = ""
    note: str = ""
    """Part of the order that is not carried out as asked."""
    timeout: float = math.inf
    """s of simulated time."""

    @property
    def follows(self) -> bool:
        """True for a path, False for goals."""
        return self.kind.endswith("path")


@dataclass(frozen=True)
class Orders:
    """Calls that the desk makes of the controller's node; each may be called from any thread."""

    ride: Callable[[list[PoseStamped], bool], tuple[list[int], str]]
    """Takes poses and whether the last one's orientation is the direction of arrival; returns the
    goals' numbers and why that is not kept, or raises ValueError."""
    follow: Callable[[Any, str, int, float, float], int]
    """Takes a path, a course's name, laps, speed and noise; returns the path's number or raises
    ValueError."""
    cancel: Callable[[int], None]
    """Function that ends the path of that number, or with zero the ride to goals."""
    state: Callable[[], tuple[BicycleState | None, float]]
    """Returns the newest state and its simulated time, s."""


class ActionDesk:
    """Serves the actions of one controller."""

    def __init__(self, node: Node, orders: Orders) -> None:
        """Start to serve beside `node`, whose namespace holds."""
        self._orders = orders
        self._events: queue.SimpleQueue[Event | PathReport | str] = queue.SimpleQueue()
        self._alive: list[Order] = []
        self._node = Node(
            f"{node.get_name()}_actions",
            namespace=node.get_namespace(),
            use_global_arguments=False,
            start_parameter_services=False,
        )
        self._servers = [self._serve(kind, *entry) for kind, entry in self._entries(node).items()]
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._node.create_timer(PERIOD, self._on_timer, clock=steady)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin, name="actions", daemon=True)
        self._thread.start()

    def _entries(self, node: Node) -> dict[str, tuple[Any, str]]:
        """Return each action's type and name, by kind."""
        ours = topics.RIDE_TO_POSE, topics.FOLLOW_PATH_ACTION
        found = {"pose": (ours[0].type, ours[0].name), "path": (ours[1].type, ours[1].name)}
        if nav2 is not None:
            found["nav2 pose"] = nav2.NavigateToPose, "navigate_to_pose"
            found["nav2 poses"] = nav2.NavigateThroughPoses, "navigate_through_poses"
            found["nav2 path"] = nav2.FollowPath, "follow_path"
        full = node.resolve_service_name
        return {kind: (action_type, full(name)) for kind, (action_type, name) in found.items()}

    def _serve(self, kind: str, action_type: Any, name: str) -> ActionServer:
        async def execute(handle: Any) -> Any:
            return await self._execute(kind, action_type, handle)

        return ActionServer(
            self._node,
            action_type,
            name,
            execute,
            cancel_callback=lambda handle: CancelResponse.ACCEPT,
        )

    def _spin(self) -> None:
        with contextlib.suppress(ExternalShutdownException):
            self._executor.spin()

    def close(self) -> None:
        """Stop serving."""
        self._executor.shutdown(timeout_sec=LAST)
        self._thread.join(LAST)
        for server in self._servers:
            server.destroy()
        self._node.destroy_node()

    def tell(self, event: Event | PathReport) -> None:
        """Take a change of a goal or a path; called in the loop's thread."""
        self._events.put(event)

    def end(self, why: str) -> None:
        """End what has been ordered, for it is not ridden any more; called in any thread."""
        self._events.put(why)

    async def _execute(self, kind: str, action_type: Any, handle: Any) -> Any:
        order = Order(handle, Future(), kind, [])
        order.began = self._orders.state()[1]
        self._take_events()  # the previous one may have ended
        self._alive.append(order)
        try:
            self._begin(order, handle.request)
        except Exception as error:  # whatever it is, the client must be answered
            expected = isinstance(error, ValueError)
            order.reason = str(error) if expected else f"{type(error).__name__}: {error}"
            self._alive.remove(order)
            handle.abort()
            return self._result(order, action_type.Result())
        if not order.follows:  # goals are taken at once
            self._supersede(order)
        await order.done
        self._alive.remove(order)
        self._end(order)
        return self._result(order, action_type.Result())

    def _supersede(self, order: Order) -> None:
        """End all orders before one that is taken now."""
        for other in self._alive[: self._alive.index(order)]:
            if not other.done.done():
                other.reason = NEWER
                other.done.set_result(None)

    def _begin(self, order: Order, request: Any) -> None:
        """Give the order to the controller.

        Raises:
            ValueError: if it cannot be taken.
        """
        ending = order.kind.rpartition(" ")[2]
        if ending == "path":
            laps, speed, noise = 0, 0.0, 0.0
            course = ""
            if isinstance(request, FollowPath.Goal):
                course, laps = request.course, int(request.laps)
                speed, noise = float(request.speed), float(request.noise)
            order.ids = [self._orders.follow(request.path, course, laps, speed, noise)]
            return
        poses = list(request.poses) if ending == "poses" else [request.pose]
        if not poses:
            raise ValueError("no pose is given")
        use = True
        if isinstance(request, RideToPose.Goal):
            poses, use = [*request.through, request.pose], request.use_heading
            if not request.timeout >= 0.0:
                raise ValueError(f"timeout is {request.timeout:g}: give 0 or more seconds")
            order.timeout = request.timeout or math.inf
        order.yaw = convert.to_yaw(poses[-1].pose.orientation) if use else math.nan
        order.ids, order.note = self._orders.ride(poses, use)
        order.left = len(order.ids)

    def _on_timer(self) -> None:
        """Look at events and requests to cancel; publish feedback."""
        self._take_events()
        for order in list(self._alive):
            if not order.done.done():
                self._look_after(order)

    def _look_after(self, order: Order) -> None:
        """Cancel an order that is to end, or publish its feedback."""
        late = self._orders.state()[1] - order.began > order.timeout
        if (late or order.handle.is_cancel_requested) and not order.cancelled:
            order.cancelled = True
            if not order.handle.is_cancel_requested:
                order.reason = f"{LATE} {order.timeout:g} s"
            self._orders.cancel(order.ids[0] if order.follows else 0)
        if order.cancelled:
            order.patience -= 1
            if order.patience == 0:  # without states no goal status follows
                order.done.set_result(None)
            return
        self._feed(order)

    def _take_events(self) -> None:
        """Look at the events that have come."""
        while not self._events.empty():
            event = self._events.get()
            for order in list(self._alive):
                if order.done.done():
                    continue
                if not isinstance(event, str):
                    self._look(order, event)
                else:
                    order.reason = event
                    order.done.set_result(None)

    def _look(self, order: Order, event: Event | PathReport) -> None:
        """Take one event; end the order if it is its last."""
        if isinstance(event, PathReport):
            if not order.follows or event.path_id not in order.ids:
                return
            if event.status in RIDDEN:
                self._supersede(order)
            order.last = event
            over = event.status is not PathEnd.ACTIVE
        else:
            if order.follows or event.goal.goal_id not in order.ids:
                return
            order.last = event
            ended = event.status not in RUNNING
            order.left -= ended
            bad = ended and event.status is not Status.REACHED
            over = order.left <= 0 or bad
        if not over or order.done.done():
            return
        if self._alive[-1] is not order and not order.cancelled and _taken_away(event):
            order.reason = NEWER
        order.done.set_result(None)

    def _end(self, order: Order) -> None:
        """Tell the client how its order ended."""
        last = order.last
        if _good(last) and not order.reason:
            order.handle.succeed()
        elif order.handle.is_cancel_requested:
            order.handle.canceled()
        else:
            order.handle.abort()

    def _result(self, order: Order, result: Any) -> Any:
        """Fill in a result."""
        snapshot, now = self._orders.state()
        last, message = order.last, order.reason
        if last is not None and not message:
            message = last.message
        if order.note:
            message = f"{message}; arrives in any direction: {order.note}".lstrip("; ")
        if isinstance(result, RideToPose.Result):
            result.status = int(last.status) if isinstance(last, Event) else int(Status.REJECTED)
            if order.reason.startswith(LATE):
                result.status = int(Status.GIVEN_UP)
            result.distance = float(last.distance) if isinstance(last, Event) else math.nan
            result.heading_error = _off(snapshot, order.yaw)
            result.elapsed = max(0.0, now - order.began)
        elif isinstance(result, FollowPath.Result):
            report = last if isinstance(last, PathReport) else None
            result.status = int(report.status if report else PathEnd.REJECTED)
            result.rms = float(report.rms) if report else math.nan
            result.largest = float(report.largest) if report else math.nan
            result.elapsed = float(report.elapsed) if report else 0.0
        if order.reason == NEWER and hasattr(result, "status"):
            result.status = int(PathEnd.REPLACED if order.follows else Status.REPLACED)
        elif order.handle.is_cancel_requested and hasattr(result, "status") and not _good(last):
            result.status = int(PathEnd.CANCELLED if order.follows else Status.CANCELLED)
        if hasattr(result, "error_code"):
            result.error_code = _error_code(order, result)
        for name in ("message", "error_msg"):
            if hasattr(result, name):
                setattr(result, name, message)
        return result

    def _feed(self, order: Order) -> None:
        """Publish feedback of the order's kind."""
        snapshot, now = self._orders.state()
        if snapshot is None:
            return
        last, elapsed = order.last, max(0.0, now - order.began)
        handle = order.handle
        request = handle.request
        if isinstance(request, RideToPose.Goal):
            handle.publish_feedback(
                RideToPose.Feedback(
                    distance=_distance(snapshot, request.pose),
                    speed=float(snapshot.speed),
                    lean=-float(snapshot.lean_angle),
                    elapsed=elapsed,
                    remaining=max(0, order.left),
                )
            )
        elif isinstance(request, FollowPath.Goal):
            if isinstance(last, PathReport):
                handle.publish_feedback(
                    FollowPath.Feedback(
                        lap=int(last.lap),
                        along=float(last.along),
                        length=float(last.length),
                        cross_track=float(last.cross_track),
                        heading_error=float(last.heading_error),
                        speed=float(snapshot.speed),
                    )
                )
        else:
            self._feed_nav2(order, snapshot, elapsed)

    def _feed_nav2(self, order: Order, snapshot: BicycleState, elapsed: float) -> None:
        """Fill in the fields that nav2's feedbacks share."""
        request, last = order.handle.request, order.last
        names = {"nav2 pose": "NavigateToPose", "nav2 poses": "NavigateThroughPoses"}
        feedback = getattr(nav2, names.get(order.kind, "FollowPath")).Feedback()
        if order.kind == "nav2 path":
            if not isinstance(last, PathReport):
                return
            left = last.length - last.along
            feedback.distance_to_goal, feedback.speed = float(left), float(snapshot.speed)
        else:
            poses = request.poses if order.kind == "nav2 poses" else [request.pose]
            feedback.current_pose = _pose_of(snapshot, self._node)
            feedback.distance_remaining = _distance(snapshot, poses[-1])
            feedback.navigation_time.sec = int(elapsed)
            feedback.navigation_time.nanosec = int(elapsed % 1.0 * 1e9)
            if order.kind == "nav2 poses":
                feedback.number_of_poses_remaining = max(0, order.left)
        order.handle.publish_feedback(feedback)


def _good(last: Event | PathReport | None) -> bool:
    """Return True for the last word of an order that was carried out."""
    return last is not None and (last.status is Status.REACHED or last.status is PathEnd.FINISHED)


def _taken_away(event: Event | PathReport) -> bool:
    """Return True if another order may have ended this one."""
    if isinstance(event, PathReport):
        return event.status in (PathEnd.CANCELLED, PathEnd.REPLACED)
    return event.status in (Status.CANCELLED, Status.REPLACED)


def _error_code(order: Order, result: Any) -> int:
    """Return nav2's number for why an order was not carried out; 0 if it was, or was cancelled."""
    if (_good(order.last) and not order.reason) or order.handle.is_cancel_requested:
        return 0
    why: tuple[str, ...] = nav2_errors.OTHER
    if order.follows:
        status = order.last.status if isinstance(order.last, PathReport) else PathEnd.REJECTED
        known = {PathEnd.REJECTED: nav2_errors.INVALID_PATH, PathEnd.LOST: nav2_errors.LOST}
        why = known.get(status, why)
    elif isinstance(order.last, Event) and order.last.status is Status.GIVEN_UP:
        why = nav2_errors.LATE
    return nav2_errors.number(why, result, nav2.FollowPath.Result)


def _distance(snapshot: BicycleState, pose: PoseStamped) -> float:
    place = pose.pose.position
    return float(math.hypot(place.x - snapshot.rear_x, place.y - snapshot.rear_y))


def _off(snapshot: BicycleState | None, yaw: float) -> float:
    """Return the heading less `yaw`, rad; NaN without either."""
    if snapshot is None or math.isnan(yaw):
        return math.nan
    return float(wrap_angle(float(heading_to_yaw(snapshot.heading)) - yaw))


def _pose_of(snapshot: BicycleState, node: Node) -> PoseStamped:
    frame = frames_of(node.get_namespace()) + ODOM_FRAME
    pose = PoseStamped(header=convert.to_header(node.get_clock().now().nanoseconds, frame))
    pose.pose.position = convert.to_point((snapshot.rear_x, snapshot.rear_y))
    pose.pose.orientation = convert.to_quaternion(float(heading_to_yaw(snapshot.heading)))
    return pose
