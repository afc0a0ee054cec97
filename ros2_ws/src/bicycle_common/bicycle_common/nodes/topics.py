"""Every topic, service and QoS profile of the stack, in one place.

Names are relative, so that a namespace makes one bicycle of a fleet; `/clock` and `/diagnostics`
are absolute by convention. Publishers offer deadlines and reliability; no subscriber demands
more than ROS defaults offer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from bicycle_msgs.action import FollowPath, RideToPose
from bicycle_msgs.msg import (
    BicycleCommand,
    BicycleState,
    CommandEcho,
    DriverState,
    EpisodeInfo,
    GoalStatus,
    HandOver,
    LoopTiming,
    PathStatus,
    Push,
    TrainerStatus,
)
from bicycle_msgs.srv import LoadPolicy, Reset
from bicycle_msgs.srv import Push as PushService
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import (
    PoseStamped,
    PoseWithCovarianceStamped,
    Twist,
    TwistStamped,
    TwistWithCovarianceStamped,
)
from nav_msgs.msg import Odometry, Path
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState, NavSatFix, TimeReference
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from bicycle_common import topic_names

ODOM_FRAME = "odom"
BASE_FRAME = "base_link"
GOAL_FRAMES = ("odom", "map")
"""Frames allowed for goals: with simulated ground truth the two are identical."""

STATE_PERIOD = 0.1
"""Period at which the state is published again while nothing moves (s)."""


def _profile(depth: int, latched: bool = False, reliable: bool = True) -> QoSProfile:
    """Return a profile that keeps the last `depth`; latched messages reach late subscribers."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def _offered(depth: int, deadline: float) -> QoSProfile:
    """Return a publisher's profile that offers a deadline, s."""
    profile = _profile(depth)
    profile.deadline = Duration(seconds=deadline)
    return profile


@dataclass(frozen=True)
class Topic:
    """One topic: its name, its type, and its profiles for publishers and subscribers."""

    name: str
    type: Any
    publish: QoSProfile
    subscribe: QoSProfile


def _topic(name: str, kind: Any, depth: int = 5, latched: bool = False) -> Topic:
    profile = _profile(depth, latched)
    return Topic(name, kind, profile, profile)


RESEND = 2400
"""Messages that a publisher keeps for a slow recorder: one minute at 40 Hz.

Subscribers take the newest. Only unconfirmed messages are kept: 10 MB in the simulator if a
recorder stands still.
"""

STATE = Topic(topic_names.STATE, BicycleState, _offered(RESEND, 2.5 * STATE_PERIOD), _profile(5))
COMMAND = Topic(
    topic_names.COMMAND, BicycleCommand, _offered(RESEND, 2.5 * STATE_PERIOD), _profile(5)
)
COMMAND_ECHO = Topic(
    topic_names.COMMAND_ECHO, CommandEcho, _offered(RESEND, 2.5 * STATE_PERIOD), _profile(5)
)
ODOMETRY = Topic(topic_names.ODOMETRY, Odometry, _offered(RESEND, 2.5 * STATE_PERIOD), _profile(5))
JOINT_STATES = Topic(
    topic_names.JOINT_STATES, JointState, _offered(RESEND, 2.5 * STATE_PERIOD), _profile(5)
)
CLOCK = Topic(topic_names.CLOCK, Clock, _profile(1, reliable=False), _profile(1, reliable=False))
TF = _topic(topic_names.TF, TFMessage, depth=100)
TF_STATIC = _topic(topic_names.TF_STATIC, TFMessage, depth=1, latched=True)
ROBOT_DESCRIPTION = _topic(topic_names.ROBOT_DESCRIPTION, String, depth=1, latched=True)
MARKERS = _topic(topic_names.MARKERS, MarkerArray, depth=1)
DIAGNOSTICS = _topic(topic_names.DIAGNOSTICS, DiagnosticArray, depth=10)
GOAL_MARKER = _topic(topic_names.GOAL_MARKER, Marker, depth=1, latched=True)
TIMING = _topic(topic_names.TIMING, LoopTiming, depth=RESEND)
PUSHED = _topic(topic_names.PUSHED, Push, depth=RESEND)
EPISODE = _topic(topic_names.EPISODE, EpisodeInfo, depth=1, latched=True)
INITIAL_POSE = _topic(topic_names.INITIAL_POSE, PoseWithCovarianceStamped)
GOAL_POSE = _topic(topic_names.GOAL_POSE, PoseStamped)
GOAL_PATH = _topic(topic_names.GOAL_PATH, Path)
ORDERED_GOALS = _topic(topic_names.ORDERED_GOALS, Path)
"""Goals that came by action, as `GOAL_PATH` has the others."""
FOLLOW_PATH = _topic(topic_names.FOLLOW_PATH, Path)
FOLLOWED_PATH = _topic(topic_names.FOLLOWED_PATH, Path, depth=1, latched=True)
PATH_STATUS = _topic(topic_names.PATH_STATUS, PathStatus, depth=10, latched=True)
CMD_VEL = _topic(topic_names.CMD_VEL, TwistStamped, depth=1)
CMD_VEL_PLAIN = _topic(topic_names.CMD_VEL_PLAIN, Twist, depth=1)
ACTIVE_GOAL = _topic(topic_names.ACTIVE_GOAL, PoseStamped, depth=1, latched=True)
GOAL_STATUS = Topic(
    topic_names.GOAL_STATUS,
    GoalStatus,
    _profile(10, latched=True),
    _profile(RESEND, latched=True),  # an order of many goals tells all of them at once
)
HAND_OVER = _topic(topic_names.HAND_OVER, HandOver, depth=10, latched=True)
HAND_OVER_MARKERS = _topic(topic_names.HAND_OVER_MARKERS, MarkerArray, depth=1, latched=True)
TRAINER = _topic(topic_names.TRAINER, TrainerStatus, depth=1, latched=True)
MEASURED = 4000
"""Readings that wait for a slow or late reader: a rest of some seconds is published at once, when
nobody may be there yet."""
IMU = _topic(topic_names.IMU, Imu, depth=MEASURED, latched=True)
ENCODERS = _topic(topic_names.ENCODERS, JointState, depth=MEASURED, latched=True)
"""Encoders: position and effort of `steer`, velocity of `rear_wheel` in m/s at the rim."""
GNSS_FIX = _topic(topic_names.GNSS_FIX, NavSatFix, depth=MEASURED, latched=True)
GNSS_VELOCITY = _topic(
    topic_names.GNSS_VELOCITY, TwistWithCovarianceStamped, depth=MEASURED, latched=True
)
SENSOR_TIME = _topic(topic_names.SENSOR_TIME, TimeReference, depth=RESEND)
"""The sensors' clock at a step; `source` is episode and step."""
ESTIMATE = Topic(topic_names.ESTIMATE, BicycleState, _profile(RESEND, latched=True), _profile(5))
"""Estimates, latched for late recorders: each estimate is computed from the one before."""
ESTIMATED_ODOMETRY = Topic(topic_names.ESTIMATED_ODOMETRY, Odometry, _profile(RESEND), _profile(5))
DRIVER_STATE = _topic(topic_names.DRIVER_STATE, DriverState, depth=RESEND)
CONTROLLER_SETUP = _topic(topic_names.CONTROLLER_SETUP, String, depth=1, latched=True)
"""JSON of the parameters and sensors of a controller, with which its commands can be computed
again."""

TOPICS: tuple[Topic, ...] = (
    STATE,
    COMMAND,
    COMMAND_ECHO,
    ODOMETRY,
    JOINT_STATES,
    CLOCK,
    TF,
    TF_STATIC,
    ROBOT_DESCRIPTION,
    MARKERS,
    GOAL_MARKER,
    DIAGNOSTICS,
    TIMING,
    PUSHED,
    EPISODE,
    INITIAL_POSE,
    GOAL_POSE,
    GOAL_PATH,
    ORDERED_GOALS,
    FOLLOW_PATH,
    FOLLOWED_PATH,
    PATH_STATUS,
    CMD_VEL,
    CMD_VEL_PLAIN,
    ACTIVE_GOAL,
    GOAL_STATUS,
    HAND_OVER,
    HAND_OVER_MARKERS,
    TRAINER,
    IMU,
    ENCODERS,
    GNSS_FIX,
    GNSS_VELOCITY,
    SENSOR_TIME,
    ESTIMATE,
    ESTIMATED_ODOMETRY,
    DRIVER_STATE,
    CONTROLLER_SETUP,
)
"""All topics."""


@dataclass(frozen=True)
class Service:
    """One service: its name and its type."""

    name: str
    type: Any


@dataclass(frozen=True)
class Action:
    """One action: its name and its type."""

    name: str
    type: Any


RIDE_TO_POSE = Action(topic_names.RIDE_TO_POSE, RideToPose)
FOLLOW_PATH_ACTION = Action(topic_names.FOLLOW_PATH_ACTION, FollowPath)

RESET = Service(topic_names.RESET, Reset)
PAUSE = Service(topic_names.PAUSE, SetBool)
STEP = Service(topic_names.STEP, Trigger)
PUSH = Service(topic_names.PUSH, PushService)
LOAD_POLICY = Service(topic_names.LOAD_POLICY, LoadPolicy)
ARM = Service(topic_names.ARM, SetBool)
ESTOP = Service(topic_names.ESTOP, Trigger)
STOP_BUTTON = Service(topic_names.STOP_BUTTON, SetBool)
"""The button of a simulated microcontroller; a real one is a thing to press."""


def advertise(node: Node, *topics: Topic) -> dict[str, Publisher]:
    """Return publishers of `topics` by topic name."""
    return {t.name: node.create_publisher(t.type, t.name, t.publish) for t in topics}


def listen(node: Node, topic: Topic, callback: Callable[..., None], depth: int = 0) -> Any:
    """Call `callback` with every message of `topic`; with a depth, with the newest only.

    A callback that takes two arguments gets rclpy's facts about the message, too.

    Returns:
        The subscription, for a node that ends it before its own end.
    """
    profile = topic.subscribe if depth == 0 else depth
    return node.create_subscription(topic.type, topic.name, callback, profile)


def serve(node: Node, service: Service, callback: Callable[[Any, Any], Any]) -> None:
    """Handle calls of `service`."""
    node.create_service(service.type, service.name, callback)
