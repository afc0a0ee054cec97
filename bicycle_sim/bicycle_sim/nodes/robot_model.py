"""Transforms of the ridden bicycle, for RViz, Foxglove and anything that reads TF.

Frames: `odom` → `base_footprint` (the rear contact, heading only) → `base_link` (leans with the
rear frame) → `steer_link` → `front_wheel_link`; `rear_wheel_link` and `crank_link` hang on
`base_link`, and so do `imu_link` and `gnss_link` where there are sensors. With simulated truth
`map` → `odom` is the identity. A namespace is put before each frame but `map`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from tf2_msgs.msg import TFMessage

from bicycle_common.conventions import mirror
from bicycle_common.nodes.convert import to_header, to_quaternion, yaw_of
from bicycle_common.types import BicycleState
from bicycle_sim.plants.base import Geometry
from bicycle_sim.sensors.settings import SensorSettings

FOOTPRINT = "base_footprint"
"""Frame of the rear contact."""


@dataclass(frozen=True)
class Mount:
    """Position and orientation of a sensor in `base_link`."""

    frame: str
    position: tuple[float, float, float]
    """m."""
    angles: tuple[float, float, float]
    """Roll, pitch and yaw, rad."""


def frames_of(namespace: str) -> str:
    """Return the prefix of the frames of a bicycle in a namespace: "" or "b1/"."""
    inner = namespace.strip("/")
    return f"{inner}/" if inner else ""


def static_transforms(prefix: str, nanoseconds: int, mounts: Sequence[Mount] = ()) -> TFMessage:
    """Return map → odom, the identity of simulated truth, and where the sensors are mounted."""
    rows = [
        ("map", "odom", (0.0, 0.0, 0.0), Quaternion(w=1.0)),
        *(("base_link", m.frame, m.position, _turned(m.angles)) for m in mounts),
    ]
    return TFMessage(transforms=[_transform(prefix, nanoseconds, *row) for row in rows])


def mounts_of(sensors: SensorSettings | None) -> tuple[Mount, ...]:
    """Return the mounts of the sensors that have a place: IMU and GNSS; none without sensors."""
    if sensors is None:
        return ()
    imu, gnss = sensors.imu, sensors.gnss
    found = []
    if imu.rate > 0.0:
        roll, pitch, yaw = map(math.radians, imu.mounting)
        found.append(Mount("imu_link", _triple(imu.position), (roll, pitch, yaw)))
    if gnss.rate > 0.0:
        found.append(Mount("gnss_link", _triple(gnss.position), (0.0, 0.0, 0.0)))
    return tuple(found)


def transforms(
    snapshot: BicycleState, nanoseconds: int, geometry: Geometry, prefix: str, travel: float
) -> TFMessage:
    """Return the tree's moving transforms.

    Args:
        snapshot: the state.
        nanoseconds: its simulated time.
        geometry: the bicycle's geometry.
        prefix: see `frames_of`.
        travel: m that the wheels have rolled.
    """
    g = geometry
    roll = mirror("lean_angle", snapshot.lean_angle)
    tilt = g.steer_axis_tilt
    # The steering axis is z of steer_link: it leans back by the tilt.
    steer = _product(_about_y(-tilt), to_quaternion(float(snapshot.steer_angle)))
    front, rear, pedalled = (_about_y(turn * travel) for turn in g.wheel_turns)
    rows = (
        (
            "odom",
            FOOTPRINT,
            (snapshot.rear_x, snapshot.rear_y, 0.0),
            to_quaternion(yaw_of(snapshot)),
        ),
        (FOOTPRINT, "base_link", (0.0, 0.0, 0.0), to_quaternion(0.0, roll)),
        ("base_link", "rear_wheel_link", (0.0, 0.0, g.rear_radius), rear),
        ("base_link", "crank_link", crank(g), pedalled),
        ("base_link", "steer_link", head(g), steer),
        ("steer_link", "front_wheel_link", wheel_in_steer(g), front),
    )
    return TFMessage(transforms=[_transform(prefix, nanoseconds, *row) for row in rows])


def _transform(
    prefix: str,
    nanoseconds: int,
    parent: str,
    child: str,
    at: tuple[float, float, float],
    turn: Quaternion,
) -> TransformStamped:
    """Return one transform; all bicycles of a fleet share `map`."""
    return TransformStamped(
        header=to_header(nanoseconds, parent if parent == "map" else prefix + parent),
        child_frame_id=prefix + child,
        transform=Transform(
            translation=Vector3(x=float(at[0]), y=float(at[1]), z=float(at[2])),
            rotation=turn,
        ),
    )


def head(g: Geometry) -> tuple[float, float, float]:
    """Return a point of the steering axis in base_link, 0.75 m high, m."""
    height = 0.75
    # The axis meets the ground by the trail before the front contact.
    return g.wheelbase + g.trail - height * math.tan(g.steer_axis_tilt), 0.0, height


def wheel_in_steer(g: Geometry) -> tuple[float, float, float]:
    """Return the front wheel's centre in steer_link at zero steering, m."""
    x, _, z = head(g)
    dx, dz = g.wheelbase - x, g.front_radius - z
    c, s = math.cos(g.steer_axis_tilt), math.sin(g.steer_axis_tilt)
    return c * dx + s * dz, 0.0, -s * dx + c * dz


def crank(g: Geometry) -> tuple[float, float, float]:
    """Return the crank's axle in base_link, m."""
    return 0.42 * g.wheelbase, 0.0, 0.28


def _about_y(angle: float) -> Quaternion:
    half = 0.5 * math.remainder(angle, 2.0 * math.pi)
    return Quaternion(y=math.sin(half), w=math.cos(half))


def _product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the rotation by b in the frame turned by a."""
    return Quaternion(
        w=a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
        x=a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
        y=a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
        z=a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
    )


def _turned(angles: tuple[float, float, float]) -> Quaternion:
    """Return the rotation by roll, pitch and yaw about fixed axes, rad (REP-103)."""
    roll, pitch, yaw = angles
    return _product(_product(to_quaternion(yaw), _about_y(pitch)), to_quaternion(0.0, roll))


def _triple(values: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z
