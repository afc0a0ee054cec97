"""Names of all topics and services, for nodes and for readers of bags.

Names are relative, so that a namespace selects one bicycle of a fleet; only `CLOCK` and
`DIAGNOSTICS` are absolute, by convention. A bag of one bicycle has them below `/`, see
`in_bag`.
"""

from __future__ import annotations

STATE = "bicycle/state"
COMMAND = "bicycle/command"
COMMAND_ECHO = "bicycle/command_echo"
ODOMETRY = "odom"
JOINT_STATES = "joint_states"
CLOCK = "/clock"
TF = "/tf"
TF_STATIC = "/tf_static"
ROBOT_DESCRIPTION = "robot_description"
MARKERS = "bicycle/markers"
GOAL_MARKER = "bicycle/goal_marker"
DIAGNOSTICS = "/diagnostics"
TRANSITION = "bicycle/transition"
"""Topic of transitions, in bags of earlier releases only."""
TIMING = "bicycle/timing"
PUSHED = "bicycle/pushed"
EPISODE = "bicycle/episode"
INITIAL_POSE = "initialpose"
GOAL_POSE = "goal_pose"
GOAL_PATH = "goal_path"
ORDERED_GOALS = "bicycle/ordered_goals"
FOLLOW_PATH = "follow_path"
FOLLOWED_PATH = "bicycle/path"
PATH_STATUS = "bicycle/path_status"
CMD_VEL = "cmd_vel"
CMD_VEL_PLAIN = "cmd_vel_unstamped"
ACTIVE_GOAL = "bicycle/active_goal"
GOAL_STATUS = "bicycle/goal_status"
HAND_OVER = "bicycle/hand_over"
HAND_OVER_MARKERS = "bicycle/hand_over_markers"
TRAINER = "bicycle/trainer"

RIDE_TO_POSE = "bicycle/ride_to_pose"
FOLLOW_PATH_ACTION = "bicycle/follow_path"
IMU = "imu/data_raw"
ENCODERS = "encoders"
GNSS_FIX = "gnss/fix"
GNSS_VELOCITY = "gnss/vel"
SENSOR_TIME = "sensors/time"
ESTIMATE = "bicycle/estimate"
ESTIMATED_ODOMETRY = "odom_estimated"
DRIVER_STATE = "bicycle/driver_state"
CONTROLLER_SETUP = "bicycle/controller_setup"

RESET = "bicycle/reset"
PAUSE = "bicycle/pause"
STEP = "bicycle/step"
PUSH = "bicycle/push"
LOAD_POLICY = "bicycle/load_policy"
ARM = "bicycle/arm"
ESTOP = "bicycle/estop"
STOP_BUTTON = "bicycle/stop_button"


def in_bag(name: str) -> str:
    """Return the absolute name of a relative one, for a bicycle without a namespace."""
    return f"/{name}"
