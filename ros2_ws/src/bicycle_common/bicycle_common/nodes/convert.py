"""Conversions between messages and the numbers of the pure code; signs as in `conventions.py`.

The code uses the paper's convention: lean omega > 0 to the left, heading psi counter-clockwise
from +y, psi_g > 0 for a goal to the right. Messages use REP-103: roll > 0 to the right, yaw
counter-clockwise from +x, heading error > 0 for a goal to the left. Negation is exact, and the
heading is taken from the contacts as the paper's dynamics do, so such a state survives the trip to
the bit. That of another plant is whole in `plant_state`, in the plant's own order and signs.
"""

from __future__ import annotations

import math

import numpy as np
from bicycle_msgs.msg import BicycleCommand, CommandEcho
from bicycle_msgs.msg import BicycleState as BicycleStateMessage
from bicycle_msgs.msg import Push as PushMessage
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point as PointMessage
from geometry_msgs.msg import Pose, Quaternion
from std_msgs.msg import Header

from bicycle_common import arrival
from bicycle_common.conventions import mirror
from bicycle_common.geometry import heading_between, heading_to_yaw, yaw_to_heading
from bicycle_common.nodes.topics import GOAL_FRAMES, ODOM_FRAME
from bicycle_common.types import (
    AppliedCommand,
    BicycleState,
    Command,
    CommandSource,
    InitialPose,
    Point2D,
    Push,
)

BODY = (
    "lean_angle",
    "lean_rate",
    "lean_acceleration",
    "steer_angle",
    "steer_rate",
    "speed",
    "yaw_rate",
    "pitch",
)
"""Fields of a state that a message has under the same name, up to sign."""


def to_stamp(nanoseconds: int) -> Time:
    """Return a time in ns as a stamp."""
    return Time(sec=int(nanoseconds // 10**9), nanosec=int(nanoseconds % 10**9))


def to_header(nanoseconds: int, frame: str = ODOM_FRAME) -> Header:
    """Return a header with a time in ns."""
    return Header(stamp=to_stamp(nanoseconds), frame_id=frame)


def to_point(point: Point2D | None, z: float = 0.0) -> PointMessage:
    """Return a point of the plane, m; NaN without a point."""
    x, y = (math.nan, math.nan) if point is None else point
    return PointMessage(x=float(x), y=float(y), z=float(z))


def to_quaternion(yaw: float, roll: float = 0.0) -> Quaternion:
    """Return the rotation by roll about the forward axis, then yaw about the vertical one, rad."""
    cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
    return Quaternion(x=cy * sr, y=sy * sr, z=sy * cr, w=cy * cr)


def to_arrival(yaw: float | None) -> Quaternion:
    """Return the orientation of a goal that is to be reached with a yaw, rad; None for any."""
    x, y, z, w = arrival.orientation_of(yaw)
    return Quaternion(x=x, y=y, z=z, w=w)


def arrival_of(quaternion: Quaternion) -> float | None:
    """Return the yaw that a goal's orientation asks for, rad; None for any."""
    return arrival.yaw_of((quaternion.x, quaternion.y, quaternion.z, quaternion.w))


def to_yaw(quaternion: Quaternion) -> float:
    """Return the yaw of a quaternion, rad.

    Raises:
        ValueError: if it is not finite or not of unit length.
    """
    x, y, z, w = (float(getattr(quaternion, name)) for name in "xyzw")
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if not abs(length - 1.0) <= arrival.UNIT_TOLERANCE:
        raise ValueError(
            f"the orientation ({x:g}, {y:g}, {z:g}, {w:g}) must have length 1, not {length:g}"
        )
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def yaw_of(snapshot: BicycleState) -> float:
    """Return the REP-103 yaw of a state, rad."""
    return float(heading_to_yaw(snapshot.heading))


def from_snapshot(snapshot: BicycleState, nanoseconds: int) -> BicycleStateMessage:
    """Return the state message at a simulated time in ns."""
    return BicycleStateMessage(
        header=to_header(nanoseconds),
        episode=int(snapshot.episode),
        step=int(snapshot.step),
        **{name: mirror(name, float(getattr(snapshot, name))) for name in BODY},
        heading=yaw_of(snapshot),
        front_contact=to_point((snapshot.front_x, snapshot.front_y)),
        rear_contact=to_point((snapshot.rear_x, snapshot.rear_y)),
        fallen=bool(snapshot.fallen),
        plant_state=[float(value) for value in snapshot.plant_state],
        estimated=bool(snapshot.estimated),
    )


def to_snapshot(message: BicycleStateMessage) -> BicycleState:
    """Return the state of a message; `Simulator.restore` can continue from it."""
    front, rear = message.front_contact, message.rear_contact
    x_b, y_b, x_f, y_f = (np.array([value]) for value in (rear.x, rear.y, front.x, front.y))
    if message.plant_state or message.estimated:
        heading = float(yaw_to_heading(message.heading))
    else:
        heading = float(heading_between(x_b, y_b, x_f, y_f)[0])
    return BicycleState(
        episode=int(message.episode),
        step=int(message.step),
        **{name: mirror(name, getattr(message, name)) for name in BODY},
        heading=heading,
        front_x=front.x,
        front_y=front.y,
        rear_x=rear.x,
        rear_y=rear.y,
        fallen=bool(message.fallen),
        plant_state=tuple(message.plant_state),
        estimated=bool(message.estimated),
    )


def from_command(command: Command, stamp: Time) -> BicycleCommand:
    """Return the command message."""
    return BicycleCommand(
        header=Header(stamp=stamp),
        episode=int(command.episode),
        step=int(command.step),
        torque=float(command.torque),
        displacement=float(command.displacement),
        pedal_force=float(command.pedal_force),
        has_goal=command.goal is not None,
        goal_id=int(command.goal_id),
        goal=to_point(command.goal),
        controller=str(command.controller),
        policy=str(command.policy),
        heading_error=mirror("heading_error", float(command.heading_error)),
        goal_distance=float(command.goal_distance),
    )


def to_command(message: BicycleCommand) -> Command:
    """Return the command of a message, valid or not; `CommandValidator` judges it."""
    return Command(
        episode=int(message.episode),
        step=int(message.step),
        torque=message.torque,
        displacement=message.displacement,
        pedal_force=message.pedal_force,
        goal=(message.goal.x, message.goal.y) if message.has_goal else None,
        goal_id=int(message.goal_id),
        controller=message.controller,
        policy=message.policy,
        heading_error=mirror("heading_error", message.heading_error),
        goal_distance=message.goal_distance,
        message=message,
    )


def from_applied(
    applied: AppliedCommand, episode: int, step: int, nanoseconds: int
) -> CommandEcho:
    """Return the echo of the command that led to a state, at the state's simulated time in ns."""
    command = applied.command
    if command is None:
        message = BicycleCommand(
            goal=to_point(None), heading_error=math.nan, goal_distance=math.nan
        )
    elif isinstance(command.message, BicycleCommand):
        message = command.message
    else:
        message = from_command(command, to_stamp(nanoseconds))
    return CommandEcho(
        header=to_header(nanoseconds),
        episode=int(episode),
        step=int(step),
        command_source=int(applied.source),
        command=message,
    )


def to_applied(message: CommandEcho) -> AppliedCommand:
    """Return the applied command of an echo.

    Raises:
        ValueError: on an unknown source, or a command that is not finite.
    """
    source = CommandSource(int(message.command_source))
    if source not in (CommandSource.FRESH, CommandSource.HELD):
        return AppliedCommand(source)
    command = to_command(message.command)
    if not all(map(math.isfinite, (*command.action, *(command.goal or ())))):
        raise ValueError("its command is not finite")
    return AppliedCommand(source, command)


def from_push(push: Push, nanoseconds: int) -> PushMessage:
    """Return the message of an applied push, at the simulated time after its step in ns."""
    return PushMessage(
        header=to_header(nanoseconds),
        episode=int(push.episode),
        step=int(push.step),
        lean_rate=mirror("lean_rate", float(push.lean_rate)),
    )


def to_push(message: PushMessage) -> Push:
    """Return the push of a message."""
    rate = mirror("lean_rate", message.lean_rate)
    return Push(int(message.episode), int(message.step), rate)


def to_start(pose: Pose, speed: float) -> InitialPose:
    """Return the start that a pose describes: its rear contact and its yaw; speed in m/s.

    Raises:
        ValueError: on a pose that is not finite, not a rotation, or out of range.
    """
    heading = float(yaw_to_heading(to_yaw(pose.orientation)))
    return InitialPose(float(pose.position.x), float(pose.position.y), heading, float(speed))


def to_goal(frame: str, position: PointMessage, farthest: float = 1e4) -> Point2D:
    """Return the point of a goal; its height, orientation and stamp are ignored.

    Raises:
        ValueError: on an unknown frame, or if the point is not finite or beyond `farthest` m.
    """
    x, y = float(position.x), float(position.y)
    if frame.rpartition("/")[2] not in GOAL_FRAMES:  # a bicycle of a fleet has b1/odom
        raise ValueError(
            f"its frame is {frame!r}: send it in {' or '.join(map(repr, GOAL_FRAMES))}"
        )
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ValueError(f"its position ({x}, {y}) is not finite: send finite metres")
    if max(abs(x), abs(y)) > farthest:
        raise ValueError(
            f"its position ({x:g}, {y:g}) is beyond {farthest:g} m: send a nearer goal"
        )
    return x, y
