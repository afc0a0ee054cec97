"""Readings of one bicycle's sensors as ROS messages, and back to the bit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TwistWithCovarianceStamped, Vector3
from sensor_msgs.msg import Imu, JointState, NavSatFix, NavSatStatus

from bicycle_common.nodes import topics
from bicycle_common.nodes.convert import to_header
from bicycle_common.nodes.topics import Topic
from bicycle_sim.sensors.reading import Reading
from bicycle_sim.sensors.settings import SensorSettings

RADIUS = 6_378_137.0
"""m of the Earth's equator (WGS 84)."""
FLATTENING = 0.00669437999014
"""Square of the Earth's eccentricity."""
UNKNOWN = -1.0
"""First entry of the covariance of a quantity that is not measured (REP-145)."""


def messages(
    reading: Reading, base: int, sensors: SensorSettings, prefix: str = ""
) -> list[tuple[Topic, Any]]:
    """Return the messages of a reading of one bicycle.

    Args:
        reading: of one bicycle.
        base: ns that are added to its time stamp.
        sensors: whose noise the covariances tell, and whose map's origin the fixes have.
        prefix: before the frames, see `robot_model.frames_of`.
    """
    v = [float(value) for value in reading.values[0]]
    header = to_header(base + round(reading.stamp * 1e9), prefix + FRAMES[reading.sensor])
    if reading.sensor == "imu":
        s = sensors.imu
        return [
            (
                topics.IMU,
                Imu(
                    header=header,
                    orientation_covariance=[UNKNOWN, *[0.0] * 8],
                    angular_velocity=Vector3(x=v[0], y=v[1], z=v[2]),
                    angular_velocity_covariance=_diagonal(s.gyro_noise**2 * s.rate),
                    linear_acceleration=Vector3(x=v[3], y=v[4], z=v[5]),
                    linear_acceleration_covariance=_diagonal(
                        s.accelerometer_noise**2 * s.rate + s.vibration**2
                    ),
                ),
            )
        ]
    if reading.sensor == "steer":
        joint = JointState(header=header, name=["steer"], position=[v[0]], effort=[v[1]])
        return [(topics.ENCODERS, joint)]
    if reading.sensor == "wheel":
        return [(topics.ENCODERS, JointState(header=header, name=["rear_wheel"], velocity=[v[0]]))]
    return _gnss(header, v, sensors)


FRAMES = {"imu": "imu_link", "steer": "base_link", "wheel": "base_link", "gnss": "gnss_link"}


def _diagonal(variance: float) -> list[float]:
    return [float(variance) if index % 4 == 0 else 0.0 for index in range(9)]


def _metres(sensors: SensorSettings) -> tuple[float, float]:
    """m per degree of longitude and of latitude at the map's origin."""
    sine = math.sin(math.radians(sensors.gnss.latitude))
    across = RADIUS / math.sqrt(1.0 - FLATTENING * sine * sine)
    along = across * (1.0 - FLATTENING) / (1.0 - FLATTENING * sine * sine)
    east = across * math.cos(math.radians(sensors.gnss.latitude))
    return math.radians(1.0) * east, math.radians(1.0) * along


def _gnss(header: Any, v: list[float], sensors: SensorSettings) -> list[tuple[Topic, Any]]:
    g = sensors.gnss
    east, north = _metres(sensors)
    variance = g.noise**2 + g.wander**2
    fix = NavSatFix(
        header=header,
        status=NavSatStatus(status=NavSatStatus.STATUS_FIX, service=NavSatStatus.SERVICE_GPS),
        latitude=g.latitude + v[1] / north,
        longitude=g.longitude + v[0] / east,
        position_covariance=_diagonal(variance),
        position_covariance_type=NavSatFix.COVARIANCE_TYPE_DIAGONAL_KNOWN,
    )
    twist = TwistWithCovarianceStamped(header=header)
    twist.twist.twist.linear = Vector3(x=v[2], y=v[3])
    covariance = [0.0] * 36
    covariance[0] = covariance[7] = float(g.velocity_noise**2)
    twist.twist.covariance = covariance
    return [(topics.GNSS_FIX, fix), (topics.GNSS_VELOCITY, twist)]


def seconds(stamp: Time) -> float:
    """A stamp in s."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def _reading(sensor: str, stamp: Time, values: list[float]) -> Reading:
    time = seconds(stamp)
    zero = np.zeros(1)
    return Reading(sensor, time, zero + time, np.zeros(1, dtype=bool), np.array([values]))


def from_imu(message: Imu) -> Reading:
    """The reading of an IMU's message."""
    turn, force = message.angular_velocity, message.linear_acceleration
    values = [turn.x, turn.y, turn.z, force.x, force.y, force.z]
    return _reading("imu", message.header.stamp, values)


def from_encoders(message: JointState) -> list[Reading]:
    """The readings of an encoders' message.

    Raises:
        ValueError: if it lacks what its joint has.
    """
    found = []
    for index, name in enumerate(message.name):
        if name == "steer":
            values = [message.position, message.effort]
        elif name == "rear_wheel":
            values = [message.velocity]
        else:
            continue
        if any(len(part) <= index for part in values):
            raise ValueError(f"the joint {name} has no position and effort, or no velocity")
        sensor = "steer" if name == "steer" else "wheel"
        found.append(_reading(sensor, message.header.stamp, [part[index] for part in values]))
    return found


def from_gnss(fix: NavSatFix, twist: TwistWithCovarianceStamped, s: SensorSettings) -> Reading:
    """The reading of a fix and the velocity of the same time."""
    east, north = _metres(s)
    velocity = twist.twist.twist.linear
    values = [
        (fix.longitude - s.gnss.longitude) * east,
        (fix.latitude - s.gnss.latitude) * north,
        velocity.x,
        velocity.y,
    ]
    return _reading("gnss", fix.header.stamp, values)
