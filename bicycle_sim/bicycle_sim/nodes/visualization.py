"""Messages for visualization tools: odometry, joint states and markers."""

from __future__ import annotations

import math

from geometry_msgs.msg import Point, Pose, PoseWithCovariance, Twist, TwistWithCovariance, Vector3
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from bicycle_common.conventions import mirror
from bicycle_common.nodes.convert import to_header, to_point, to_quaternion, yaw_of
from bicycle_common.nodes.topics import BASE_FRAME, ODOM_FRAME
from bicycle_common.types import BicycleState
from bicycle_sim.plants.base import Geometry

JOINTS = ("steer", "front_wheel", "rear_wheel", "crank")
WHEEL_SEGMENTS = 24
HEIGHT_OF_NUMBERS = 2.1
"""Height of the words above the ground (m)."""
LETTERS = 0.18
"""Height of a capital letter (m)."""

_TYRE = ColorRGBA(r=0.1, g=0.1, b=0.1, a=1.0)
_FRAME = ColorRGBA(r=0.8, g=0.1, b=0.1, a=1.0)
_RIDER = ColorRGBA(r=0.1, g=0.3, b=0.8, a=1.0)
_WORDS = ColorRGBA(r=0.9, g=0.9, b=0.9, a=1.0)
_FALLEN = ColorRGBA(r=1.0, g=0.2, b=0.2, a=1.0)


EXACT = 1e-9
"""Variance of a simulator's truth, in any unit squared: zero would mean unknown to many."""


def odometry(
    snapshot: BicycleState, nanoseconds: int, prefix: str = "", moving: bool = True
) -> Odometry:
    """Return the rear contact's pose, with the lean as roll, and the twist in the leaning frame.

    Args:
        snapshot: the state.
        nanoseconds: its simulated time.
        prefix: before the frames, see `robot_model.frames_of`.
        moving: False while the bicycle is held, so that the twist is zero.
    """
    moving = moving and not snapshot.fallen
    roll = mirror("lean_angle", snapshot.lean_angle)
    pose = Pose(
        position=to_point((snapshot.rear_x, snapshot.rear_y)),
        orientation=to_quaternion(yaw_of(snapshot), roll),
    )
    twist = Twist()
    if moving:  # the state keeps the speed that a held bicycle goes on with
        twist.linear = Vector3(x=float(snapshot.speed))
        twist.angular = Vector3(
            x=-float(snapshot.lean_rate),
            y=float(snapshot.yaw_rate) * math.sin(roll),
            z=float(snapshot.yaw_rate) * math.cos(roll),
        )
    exact = [EXACT if row == column else 0.0 for row in range(6) for column in range(6)]
    return Odometry(
        header=to_header(nanoseconds, prefix + ODOM_FRAME),
        child_frame_id=prefix + BASE_FRAME,
        pose=PoseWithCovariance(pose=pose, covariance=exact),
        twist=TwistWithCovariance(twist=twist, covariance=exact),
    )


class Joints:
    """Joint angles; those of the wheels and the crank are integrated from the start."""

    def __init__(self, geometry: Geometry, time_step: float) -> None:
        self._geometry = geometry
        self._time_step = time_step
        self._travel = 0.0

    @property
    def travel(self) -> float:
        """m that the wheels have rolled."""
        return self._travel

    def advance(self, snapshot: BicycleState) -> None:
        """Turn the wheels by one step."""
        self._travel += snapshot.speed * self._time_step

    def message(self, snapshot: BicycleState, nanoseconds: int, moving: bool = True) -> JointState:
        """Return the angles in rad and rates in rad/s of JOINTS; see `odometry` for `moving`."""
        moving = moving and not snapshot.fallen
        turns = self._geometry.wheel_turns
        return JointState(
            header=to_header(nanoseconds),
            name=list(JOINTS),
            position=[float(snapshot.steer_angle), *(self._travel * turn for turn in turns)],
            velocity=[
                moving * float(rate)
                for rate in (snapshot.steer_rate, *(snapshot.speed * turn for turn in turns))
            ],
        )


class _Plane:
    """Points of the leaning bicycle: `along` is along its frame, `up` is in its own plane."""

    def __init__(self, snapshot: BicycleState) -> None:
        self._yaw = yaw_of(snapshot)
        self._lean = snapshot.lean_angle
        self._steer = snapshot.steer_angle
        self._rear = (snapshot.rear_x, snapshot.rear_y)
        self._front = (snapshot.front_x, snapshot.front_y)

    def at(self, front: bool, along: float, up: float) -> Point:
        """Return a point `along` and `up`, m, from the front or the rear contact."""
        x, y = self._front if front else self._rear
        direction = self._yaw + (self._steer if front else 0.0)
        sideways = up * math.sin(self._lean)
        return Point(
            x=x + along * math.cos(direction) - sideways * math.sin(self._yaw),
            y=y + along * math.sin(direction) + sideways * math.cos(self._yaw),
            z=up * math.cos(self._lean),
        )

    def wheel(self, front: bool, radius: float) -> list[Point]:
        """Return a circle that touches the ground at the contact."""
        angles = (2.0 * math.pi * i / WHEEL_SEGMENTS for i in range(WHEEL_SEGMENTS + 1))
        return [self.at(front, radius * math.sin(a), radius * (1.0 - math.cos(a))) for a in angles]


def markers(
    snapshot: BicycleState, nanoseconds: int, geometry: Geometry, prefix: str = ""
) -> MarkerArray:
    """Return markers: two wheels, a frame, the rider's mass, and words with angles in degrees.

    Args:
        snapshot: the state.
        nanoseconds: its simulated time.
        geometry: the bicycle's geometry.
        prefix: before the frames, see `robot_model.frames_of`.
    """
    plane = _Plane(snapshot)
    rear, front = geometry.rear_radius, geometry.front_radius
    frame = [
        plane.at(False, 0.0, rear),
        plane.at(False, 0.35, 0.75),
        plane.at(False, 0.9, 0.8),
        plane.at(True, 0.0, front),
        plane.at(True, -0.1, 0.95),
        plane.at(True, 0.1, 0.95),
    ]
    lines = (
        ("front wheel", plane.wheel(True, front), _TYRE),
        ("rear wheel", plane.wheel(False, rear), _TYRE),
        ("frame", frame, _FRAME),
    )
    markers = [_line(name, points, colour, nanoseconds) for name, points, colour in lines]
    markers.append(_rider(plane, geometry, nanoseconds))
    markers.append(_numbers(snapshot, nanoseconds))
    for marker in markers:
        marker.header.frame_id = prefix + ODOM_FRAME
    return MarkerArray(markers=markers)


def numbers(snapshot: BicycleState) -> str:
    """Return lean, steering and speed in words, such as "lean 3.1° right"."""
    if snapshot.fallen:
        return "fallen"
    lean, steer = _sided(snapshot.lean_angle), _sided(snapshot.steer_angle)
    return f"lean {lean}\nsteering {steer}\n{snapshot.speed:.1f} m/s"


def _sided(angle: float) -> str:
    """Return an angle that is positive to the left, rad, in degrees and words."""
    shown = f"{abs(math.degrees(angle)):.1f}°"
    if float(shown[:-1]) == 0.0:
        return shown
    return f"{shown} {'left' if angle > 0 else 'right'}"


def _numbers(snapshot: BicycleState, nanoseconds: int) -> Marker:
    marker = _marker("numbers", Marker.TEXT_VIEW_FACING, nanoseconds)
    marker.pose.position = to_point((snapshot.rear_x, snapshot.rear_y))
    marker.pose.position.z = HEIGHT_OF_NUMBERS
    marker.scale.z = LETTERS
    marker.text, marker.color = numbers(snapshot), _FALLEN if snapshot.fallen else _WORDS
    return marker


def _marker(name: str, kind: int, nanoseconds: int) -> Marker:
    marker = Marker(header=to_header(nanoseconds), ns=name, type=int(kind), action=Marker.ADD)
    marker.pose.orientation.w = 1.0
    return marker


def _line(name: str, points: list[Point], colour: ColorRGBA, nanoseconds: int) -> Marker:
    marker = _marker(name, Marker.LINE_STRIP, nanoseconds)
    marker.points, marker.color = points, colour
    marker.scale.x = 0.05
    return marker


def _rider(plane: _Plane, geometry: Geometry, nanoseconds: int) -> Marker:
    marker = _marker("rider", Marker.SPHERE, nanoseconds)
    marker.pose.position = plane.at(False, geometry.mass_forward, geometry.rider_height)
    marker.scale = Vector3(x=0.3, y=0.3, z=0.6)
    marker.color = _RIDER
    return marker
