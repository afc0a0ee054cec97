"""Transforms and a URDF of the ridden bicycle, for RViz, Foxglove and anything that reads TF.

Frames: `odom` → `base_footprint` (the rear contact, heading only) → `base_link` (leans with the
rear frame) → `steer_link` → `front_wheel_link`; `rear_wheel_link` and `crank_link` hang on
`base_link`, and so do `imu_link` and `gnss_link` where there are sensors. With simulated truth
`map` → `odom` is the identity. A namespace is put before each frame but `map`.
"""

from __future__ import annotations

import html
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
    head = _head(g)
    wheel = _wheel_in_steer(g)
    rows = (
        (
            "odom",
            FOOTPRINT,
            (snapshot.rear_x, snapshot.rear_y, 0.0),
            to_quaternion(yaw_of(snapshot)),
        ),
        (FOOTPRINT, "base_link", (0.0, 0.0, 0.0), to_quaternion(0.0, roll)),
        (
            "base_link",
            "rear_wheel_link",
            (0.0, 0.0, g.rear_radius),
            _about_y(travel / g.rear_radius),
        ),
        ("base_link", "crank_link", _crank(g), _about_y(g.crank_ratio * travel / g.rear_radius)),
        ("base_link", "steer_link", head, steer),
        ("steer_link", "front_wheel_link", wheel, _about_y(travel / g.front_radius)),
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


def urdf(geometry: Geometry, name: str, prefix: str, mounts: Sequence[Mount] = ()) -> str:
    """Return a URDF of primitives whose sizes are the bicycle's own.

    Args:
        geometry: the bicycle's geometry.
        name: the robot's name.
        prefix: see `frames_of`.
        mounts: of its sensors.
    """
    g = geometry
    tilt, head, wheel, crank = g.steer_axis_tilt, _head(g), _wheel_in_steer(g), _crank(g)
    seat = (0.28 * g.wheelbase, 0.0, 0.9)
    rider = (g.mass_forward, 0.0, g.rider_height)
    frame = [
        _tube((0.0, 0.0, g.rear_radius), crank, 0.02, "frame"),
        _tube((0.0, 0.0, g.rear_radius), seat, 0.02, "frame"),
        _tube(crank, seat, 0.02, "frame"),
        _tube(crank, head, 0.025, "frame"),
        _tube(seat, head, 0.02, "frame"),
        _shape('<sphere radius="0.16"/>', rider, (0.0, 0.0, 0.0), "rider"),
    ]
    up = 0.35
    fork = [
        _tube(wheel, (0.0, 0.0, 0.0), 0.02, "frame"),
        _tube((0.0, 0.0, 0.0), (0.0, 0.0, up), 0.02, "frame"),
        _tube((0.0, -0.28, up), (0.0, 0.28, up), 0.015, "tyre"),
    ]
    cranks = [
        _tube((0.0, 0.1, 0.0), (0.0, 0.1, -0.17), 0.012, "tyre"),
        _tube((0.0, -0.1, 0.0), (0.0, -0.1, 0.17), 0.012, "tyre"),
    ]
    links = [
        _link(prefix, FOOTPRINT, []),
        _link(prefix, "base_link", frame),
        _link(prefix, "rear_wheel_link", _wheel(g.rear_radius)),
        _link(prefix, "crank_link", cranks),
        _link(prefix, "steer_link", fork),
        _link(prefix, "front_wheel_link", _wheel(g.front_radius)),
    ]
    joints = [
        _joint(prefix, "lean", "revolute", FOOTPRINT, "base_link", (0, 0, 0), 0.0, "1 0 0", 1.6),
        _joint(
            prefix, "rear_wheel", "continuous", "base_link", "rear_wheel_link",
            (0.0, 0.0, g.rear_radius), 0.0, "0 1 0",
        ),
        _joint(prefix, "crank", "continuous", "base_link", "crank_link", crank, 0.0, "0 1 0"),
        _joint(
            prefix, "steer", "revolute", "base_link", "steer_link", head, -tilt, "0 0 1",
            g.steer_stop,
        ),
        _joint(
            prefix, "front_wheel", "continuous", "steer_link", "front_wheel_link", wheel, 0.0,
            "0 1 0",
        ),
    ]  # fmt: skip
    for mount in mounts:
        links.append(_link(prefix, mount.frame, []))
        joints.append(_fixed(prefix, mount))
    colours = {"frame": "0.8 0.1 0.1 1", "tyre": "0.1 0.1 0.1 1", "rider": "0.1 0.3 0.8 1"}
    materials = [
        f'<material name="{key}"><color rgba="{value}"/></material>'
        for key, value in colours.items()
    ]
    inner = "\n  ".join([*materials, *links, *joints])
    return f'<?xml version="1.0"?>\n<robot name="{html.escape(name)}">\n  {inner}\n</robot>\n'


def _head(g: Geometry) -> tuple[float, float, float]:
    """Return a point of the steering axis in base_link, 0.75 m high, m."""
    height = 0.75
    # The axis meets the ground by the trail before the front contact.
    return g.wheelbase + g.trail - height * math.tan(g.steer_axis_tilt), 0.0, height


def _wheel_in_steer(g: Geometry) -> tuple[float, float, float]:
    """Return the front wheel's centre in steer_link at zero steering, m."""
    head = _head(g)
    dx, dz = g.wheelbase - head[0], g.front_radius - head[2]
    c, s = math.cos(g.steer_axis_tilt), math.sin(g.steer_axis_tilt)
    return c * dx + s * dz, 0.0, -s * dx + c * dz


def _crank(g: Geometry) -> tuple[float, float, float]:
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


def _link(prefix: str, name: str, shapes: list[str]) -> str:
    return f'<link name="{prefix}{name}">{"".join(shapes)}</link>'


def _shape(
    geometry: str, at: tuple[float, float, float], rpy: tuple[float, float, float], colour: str
) -> str:
    place = " ".join(f"{value:.5g}" for value in at)
    turn = " ".join(f"{value:.5g}" for value in rpy)
    return (
        f'<visual><origin xyz="{place}" rpy="{turn}"/><geometry>{geometry}</geometry>'
        f'<material name="{colour}"/></visual>'
    )


def _tube(
    a: tuple[float, float, float], b: tuple[float, float, float], radius: float, colour: str
) -> str:
    """Return a cylinder from one point to another, m."""
    d = [q - p for p, q in zip(a, b, strict=True)]
    length = math.sqrt(sum(value * value for value in d))
    middle = tuple(0.5 * (p + q) for p, q in zip(a, b, strict=True))
    pitch = math.atan2(math.hypot(d[0], d[1]), d[2])
    yaw = math.atan2(d[1], d[0])
    shape = f'<cylinder radius="{radius:.5g}" length="{length:.5g}"/>'
    return _shape(shape, (middle[0], middle[1], middle[2]), (0.0, pitch, yaw), colour)


def _wheel(radius: float) -> list[str]:
    """Return a tyre and a spoke across it, which shows that it turns."""
    disc = f'<cylinder radius="{radius:.5g}" length="0.03"/>'
    spoke = _tube((0.0, 0.0, -0.95 * radius), (0.0, 0.0, 0.95 * radius), 0.025, "frame")
    return [_shape(disc, (0.0, 0.0, 0.0), (0.5 * math.pi, 0.0, 0.0), "tyre"), spoke]


def _joint(
    prefix: str,
    name: str,
    kind: str,
    parent: str,
    child: str,
    at: tuple[float, float, float],
    pitch: float,
    axis: str,
    limit: float = 0.0,
) -> str:
    place = " ".join(f"{value:.6g}" for value in at)
    bound = f'<limit lower="{-limit:.5g}" upper="{limit:.5g}" effort="100" velocity="100"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{prefix}{parent}"/>'
        f'<child link="{prefix}{child}"/><origin xyz="{place}" rpy="0 {pitch:.6g} 0"/>'
        f'<axis xyz="{axis}"/>{bound if kind == "revolute" else ""}</joint>'
    )


def _fixed(prefix: str, mount: Mount) -> str:
    place = " ".join(f"{value:.6g}" for value in mount.position)
    turn = " ".join(f"{value:.6g}" for value in mount.angles)
    return (
        f'<joint name="{mount.frame}" type="fixed"><parent link="{prefix}base_link"/>'
        f'<child link="{prefix}{mount.frame}"/><origin xyz="{place}" rpy="{turn}"/></joint>'
    )


def _turned(angles: tuple[float, float, float]) -> Quaternion:
    """Return the rotation by roll, pitch and yaw about fixed axes, rad (REP-103)."""
    roll, pitch, yaw = angles
    return _product(_product(to_quaternion(yaw), _about_y(pitch)), to_quaternion(0.0, roll))


def _triple(values: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z
