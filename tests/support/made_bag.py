"""A bag made by hand, with all that the page marks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bicycle_msgs.msg import BicycleCommand, BicycleState, GoalStatus, HandOver, PathStatus, Push
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path as PathMessage
from rclpy.serialization import serialize_message

from bicycle_bag.metadata import Topic
from bicycle_bag.schemas import Schemas
from bicycle_bag.writer import BagWriter
from bicycle_common.nodes.convert import to_arrival

STEPS = 200
PERIOD = 25_000_000
"""ns."""
TOPICS = {
    "/bicycle/state": BicycleState,
    "/bicycle/command": BicycleCommand,
    "/bicycle/goal_status": GoalStatus,
    "/bicycle/pushed": Push,
    "/bicycle/hand_over": HandOver,
}
ESTIMATE = "/bicycle/estimate"
ACTIVE_GOAL = "/bicycle/active_goal"
PATH, PATH_STATUS = "/bicycle/path", "/bicycle/path_status"
NAF = "naf@cee775ab58"


def write_bag(
    folder: Path, estimated: bool = False, arrival: float | None = None, course: bool = False
) -> Path:
    """Write a bag.

    5 s along +x at 2 m/s, and a reset at the end.

    It has two policies, a push at 1 s, a goal that is sent twice and reached at 4 s, a hand-over
    at 3.75 s, and a fall in the last step. With `estimated`, an estimator says from 1 s on that
    it leans by 0.1 rad, 0.2 m beside its place. With `arrival` the goal is to be reached with that
    yaw, rad. With `course` it follows a path of 2001 points from 1 s to 3 s.
    """
    topics: dict[str, Any] = TOPICS | ({ESTIMATE: BicycleState} if estimated else {})
    topics |= {ACTIVE_GOAL: PoseStamped} if arrival is not None else {}
    topics |= {PATH: PathMessage, PATH_STATUS: PathStatus} if course else {}
    with BagWriter(folder) as writer:
        schemas = Schemas()
        for name, kind in topics.items():
            full = f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
            topic = Topic(name, full, type_hash=schemas.type_hash(full))
            writer.add_topic(topic, schemas.definition(full))
        for step in range(STEPS):
            _write_step(writer, step)
            if estimated and step >= STEPS // 5:
                _write(writer, ESTIMATE, _estimate(step), step, late=2 * 10**6)
            if arrival is not None and step == 30:
                _write(writer, ACTIVE_GOAL, _headed(arrival), step)
            if course and step in COURSE:
                _write(writer, *COURSE[step], step)
        end = STEPS - 1
        _write(writer, "/bicycle/state", _state(2, 0, end), end)
    return folder


def _write(writer: BagWriter, topic: str, message: Any, step: int, late: int = 0) -> None:
    now = 10**9 + step * PERIOD
    writer.write(topic, serialize_message(message), now + late, now)


def _state(episode: int, step: int, stamp_step: int) -> BicycleState:
    state = BicycleState(episode=episode, step=step, speed=2.0)
    state.header.stamp.sec, state.header.stamp.nanosec = divmod(stamp_step * PERIOD, 10**9)
    state.rear_contact.x = 0.05 * step
    state.fallen = episode == 1 and step == STEPS - 1
    return state


def _estimate(step: int) -> BicycleState:
    estimate = _state(1, step, step)
    estimate.estimated, estimate.fallen = True, False
    estimate.lean_angle = 0.1
    estimate.rear_contact.y = 0.2
    return estimate


def _write_step(writer: BagWriter, step: int) -> None:
    _write(writer, "/bicycle/state", _state(1, step, step), step)
    policy = "first" if step < 100 else NAF
    command = BicycleCommand(episode=1, step=step, torque=0.01 * step, policy=policy)
    _write(writer, "/bicycle/command", command, step, late=10**6)
    if step == 40:
        _write(writer, "/bicycle/pushed", Push(episode=1, step=40, lean_rate=-0.3), step)
    if step in (30, 31):
        _write(writer, "/bicycle/goal_status", _goal(GoalStatus.ACTIVE, "8.0 m to go"), step)
    if step == 150:
        message = f"lean rate 0.6 rad/s is beyond 0.5 rad/s: lqr-12345678 takes over from {NAF}"
        over = HandOver(step=150, reason=HandOver.LEAN_RATE, policy="lqr-12345678")
        over.message = message.replace(NAF, f"policy {NAF}")
        _write(writer, "/bicycle/hand_over", over, step)
    if step == 160:
        _write(
            writer, "/bicycle/goal_status", _goal(GoalStatus.REACHED, "reached after 4.0 s"), step
        )


def _course() -> PathMessage:
    message = PathMessage()
    for n in range(2001):
        pose = PoseStamped()
        pose.pose.position.x, pose.pose.position.y = 0.01 * n, 1.0
        message.poses.append(pose)
    return message


COURSE = {
    39: (PATH, _course()),
    40: (PATH_STATUS, PathStatus(status=PathStatus.ACTIVE)),
    80: (PATH_STATUS, PathStatus(status=PathStatus.ACTIVE)),
    120: (PATH_STATUS, PathStatus(status=PathStatus.FINISHED)),
}
"""Messages about a followed path by their step."""


def _headed(yaw: float) -> PoseStamped:
    pose = PoseStamped()
    pose.pose.position.x = 8.0
    pose.pose.orientation = to_arrival(yaw)
    return pose


def _goal(status: int, message: str) -> GoalStatus:
    status_message = GoalStatus(goal_id=1, status=status, message=message)
    status_message.position.x = 8.0
    return status_message
