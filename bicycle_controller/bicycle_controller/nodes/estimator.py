"""The estimator within the controller: readings in, `bicycle/estimate` and odometry out."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable
from typing import Any

import numpy as np
from bicycle_msgs.msg import BicycleState as StateMessage
from geometry_msgs.msg import TwistWithCovarianceStamped, Vector3
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState, NavSatFix, TimeReference

from bicycle_common.nodes import convert, topics
from bicycle_common.nodes.topics import BASE_FRAME, ODOM_FRAME, advertise, listen
from bicycle_common.types import BicycleState
from bicycle_controller.estimation.kalman import as_body
from bicycle_controller.estimation.order import SET_BACK, Pairs
from bicycle_controller.estimation.states import LEAN, LEAN_RATE, SPEED, YAW_BIAS, Estimate
from bicycle_controller.estimation.steps import StepEstimator
from bicycle_sim.nodes import sensor_messages
from bicycle_sim.nodes.robot_model import frames_of
from bicycle_sim.plants.base import FALL_ANGLE, Plant
from bicycle_sim.sensors.reading import Reading
from bicycle_sim.sensors.settings import SensorSettings

MOST_EARLY = 20_000
"""Readings that are kept while the bicycle is not known."""

PATIENCE = 2.0
"""s for which the readings of the rest may be under way until it is told which are not there."""

TRY_AGAIN = 0.5
"""s after which it is tried again to calibrate: all readings since the rest are looked at anew."""


class Estimator:
    """Hears a bicycle's sensors and publishes what it estimates at each step."""

    def __init__(
        self,
        node: Node,
        sensors: SensorSettings,
        start: tuple[float, float, float],
        on_estimate: Callable[[StateMessage], None],
    ) -> None:
        """Listen.

        Args:
            node: whose topics.
            sensors: what the sensors are like.
            start: m, m and the heading in rad, where a ride begins.
            on_estimate: called with each estimate, after it was published.
        """
        self._node, self._sensors, self._on_estimate = node, sensors, on_estimate
        self._prefix = frames_of(node.get_namespace())
        self._publishers = advertise(node, topics.ESTIMATE, topics.ESTIMATED_ODOMETRY)
        self._steps: StepEstimator | None = None
        self._plant: Plant[Any] | None = None
        self._early: list[Reading] = []
        self._episode = -1
        self._time = -math.inf
        self._try_at = -math.inf
        self._waits_since = math.nan
        self._start = start
        self._pairs: Pairs[NavSatFix, TwistWithCovarianceStamped] = Pairs()
        self._told: tuple[str, ...] = ()
        listen(node, topics.IMU, self._on_imu)
        listen(node, topics.ENCODERS, self._on_encoders)
        if sensors.gnss.rate > 0.0:
            listen(node, topics.GNSS_FIX, self._on_fix)
            listen(node, topics.GNSS_VELOCITY, self._on_velocity)
        # Depth 1: a late estimator takes the newest step only. With all steps it would stay late.
        listen(node, topics.SENSOR_TIME, self._on_time, depth=1)

    def ride(self, plant: Plant[Any]) -> None:
        """Take the bicycle whose parameters the model has."""
        if plant != self._plant:
            self._plant = plant
            # Readings may arrive before another topic has told which bicycle they are of.
            # They were kept and are used now.
            waiting = self._early if self._steps is None else self._steps.waiting()
            self._early = []
            self._steps = StepEstimator(plant, self._sensors)
            for reading in waiting:
                self._steps.add(reading)
            self._episode = -1

    def _add(self, readings: list[Reading]) -> None:
        if self._steps is None:  # no bicycle is known yet
            self._early = [*self._early, *readings][-MOST_EARLY:]
            return
        for reading in readings:
            self._steps.add(reading)

    def _on_imu(self, message: Imu) -> None:
        self._add([sensor_messages.from_imu(message)])

    def _on_encoders(self, message: JointState) -> None:
        try:
            self._add(sensor_messages.from_encoders(message))
        except ValueError as error:
            self._node.get_logger().warning(f"encoders ignored: {error}")

    def _on_fix(self, message: NavSatFix) -> None:
        self._add_pair(self._pairs.first(_key(message), message))

    def _on_velocity(self, message: TwistWithCovarianceStamped) -> None:
        self._add_pair(self._pairs.second(_key(message), message))

    def _add_pair(self, pair: tuple[NavSatFix, TwistWithCovarianceStamped] | None) -> None:
        if pair is not None:
            self._add([sensor_messages.from_gnss(*pair, self._sensors)])

    def _on_time(self, message: TimeReference) -> None:
        """Estimate the step that this says."""
        if self._steps is None or self._plant is None:
            return
        try:
            episode, step = (int(word) for word in message.source.split())
        except ValueError:
            self._node.get_logger().warning(f"no episode and step: {message.source!r}")
            return
        time = sensor_messages.seconds(message.time_ref)
        anew = episode != self._episode or time < self._time - SET_BACK
        found = self._first(episode, step, time) if anew else self._steps.step(time)
        if found is None:
            return
        self._time = time
        problems = self._steps.problems(time)
        if problems != self._told:
            for text in problems or ("all sensors are well again",):
                self._node.get_logger().warning(text)
            self._told = problems
        state = as_state(self._plant, found, episode, step, [time, *self._steps.used.numbers])
        stamp = message.header.stamp
        now = stamp.sec * 10**9 + stamp.nanosec
        estimate = convert.from_snapshot(state, now)
        self._publishers[topics.ESTIMATE.name].publish(estimate)
        self._on_estimate(estimate)
        self._publishers[topics.ESTIMATED_ODOMETRY.name].publish(
            odometry(state, found, now, self._prefix)
        )

    def _first(self, episode: int, step: int, time: float) -> Estimate | None:
        """Return an episode's first estimate, from its whole rest; None if it lacks readings."""
        assert self._steps is not None
        assert self._plant is not None
        if clock.monotonic() < self._try_at:
            return None
        lacking = self._steps.lacking(time)  # the rest comes as one burst, topic by topic
        if lacking:
            self._wait(f"waits for {', '.join(lacking)}")
            return None
        self._steps.begin(time - step * self._plant.time_step, *self._start)
        found = self._steps.step(time)
        if self._sensors.rest > 0.0 and not found.calibrated[0]:
            self._steps.take_back()
            self._try_at = clock.monotonic() + TRY_AGAIN
            self._wait("the gyros are not calibrated: let the bicycle rest")
            return None
        self._episode, self._try_at, self._waits_since = episode, -math.inf, math.nan
        return found

    def _wait(self, why: str) -> None:
        """Tell once why there are no estimates, if that lasts."""
        now = clock.monotonic()
        if math.isnan(self._waits_since):
            self._waits_since = now
        if now - self._waits_since > PATIENCE and self._told != (why,):
            self._node.get_logger().warning(why)
            self._told = (why,)


def _key(message: NavSatFix | TwistWithCovarianceStamped) -> tuple[int, int]:
    return message.header.stamp.sec, message.header.stamp.nanosec


def as_state(
    plant: Plant[Any], estimate: Estimate, episode: int, step: int, used: list[float]
) -> BicycleState:
    """The estimate of one bicycle as a state.

    Args:
        plant: whose geometry the contacts have.
        estimate: of one bicycle.
        episode: of the simulator, or of the ride.
        step: within it.
        used: the sensors' time and the numbers of what the estimate was made from (`Used`), from
            which it can be made again; in place of a plant's own state.
    """
    body: Any = as_body(plant, estimate)
    names = (
        "lean_angle",
        "lean_rate",
        "lean_acceleration",
        "steer_angle",
        "steer_rate",
        "heading",
        "front_x",
        "front_y",
        "rear_x",
        "rear_y",
        "speed",
    )
    return BicycleState(
        episode=episode,
        step=step,
        **{name: float(getattr(body, name)[0]) for name in names},
        yaw_rate=float(estimate.yaw_rate[0]),
        pitch=float(getattr(body, "pitch", np.zeros(1))[0]),
        fallen=abs(float(body.lean_angle[0])) > FALL_ANGLE,
        plant_state=tuple(used),
        estimated=True,
    )


def odometry(
    state: BicycleState, estimate: Estimate, nanoseconds: int, prefix: str = ""
) -> Odometry:
    """Return the rear contact's pose and twist with their covariances (REP-103).

    Args:
        state: the estimated state.
        estimate: its covariances.
        nanoseconds: its time.
        prefix: before the frames, see `robot_model.frames_of`.
    """
    header = convert.to_header(nanoseconds, prefix + ODOM_FRAME)
    message = Odometry(header=header, child_frame_id=prefix + BASE_FRAME)
    message.pose.pose.position = convert.to_point((state.rear_x, state.rear_y))
    message.pose.pose.orientation = convert.to_quaternion(
        convert.yaw_of(state), -float(state.lean_angle)
    )
    place, p = estimate.course_covariance[0], estimate.covariance[0]
    pose = np.zeros((6, 6))
    pose[:2, :2] = place[1:, 1:]
    pose[5, 5] = place[0, 0]
    pose[:2, 5] = pose[5, :2] = place[0, 1:]
    pose[3, 3] = p[LEAN, LEAN]
    twist = np.zeros((6, 6))
    twist[0, 0], twist[3, 3] = p[SPEED, SPEED], p[LEAN_RATE, LEAN_RATE]
    twist[5, 5] = p[YAW_BIAS, YAW_BIAS]
    message.pose.covariance = [float(value) for value in pose.ravel()]
    message.twist.covariance = [float(value) for value in twist.ravel()]
    message.twist.twist.linear = Vector3(x=float(state.speed))
    message.twist.twist.angular = Vector3(x=-float(state.lean_rate), z=float(state.yaw_rate))
    return message
