"""URDF of the ridden bicycle: its meshes, placed and scaled by its own sizes.

`tests/tools/make_meshes.py` makes the meshes, `share/bicycle_sim/meshes/*.stl`, of unit size.
Viewers read them by `package://`; `foxglove.sh` hands them to Foxglove. A viewer that has no such
package can show the shapes for collisions, which are primitives of the same sizes.
"""

from __future__ import annotations

import html
import math
from collections.abc import Iterator, Sequence

from bicycle_sim.nodes.robot_model import FOOTPRINT, Mount, crank, head, wheel_in_steer
from bicycle_sim.plants.base import Geometry

Point = tuple[float, float, float]
"""m."""

MESHES = "package://bicycle_sim/meshes"
"""Folder of the meshes, as a URDF names it."""
COLOURS = {
    "frame": "0.8 0.1 0.1 1",
    "dark": "0.1 0.1 0.1 1",
    "metal": "0.7 0.7 0.72 1",
    "shirt": "0.1 0.3 0.8 1",
    "trousers": "0.2 0.2 0.28 1",
    "skin": "0.85 0.65 0.5 1",
}
"""Name and rgba of each material."""
SADDLE_HEIGHT = 0.9
"""m, of the saddle's top."""
STEM = 0.35
"""m, from the steering link to the handlebar."""
BAR = 0.28
"""m, half of the handlebar's width."""
CRANK_ARM = 0.17
"""m."""
TORSO, UPPER_ARM, FOREARM, THIGH, SHANK = 0.54, 0.3, 0.28, 0.46, 0.46
"""m, lengths of the rider's parts."""
ARM_REACH = 0.54
"""m from shoulder to hand up to which a rider sits upright; farther away it leans forward."""


def urdf(geometry: Geometry, name: str, prefix: str, mounts: Sequence[Mount] = ()) -> str:
    """Return the URDF of a bicycle, with a rider if its mass has one.

    Args:
        geometry: the bicycle's geometry.
        name: the robot's name.
        prefix: see `robot_model.frames_of`.
        mounts: of its sensors.
    """
    g = geometry
    body = [*_frame(g), *(_rider(g) if g.has_rider else ())]
    links = [
        _link(prefix, FOOTPRINT, []),
        _link(prefix, "base_link", [*body, *_body_shapes(g)]),
        _link(prefix, "rear_wheel_link", _wheel(g.rear_radius)),
        _link(prefix, "crank_link", [_mesh("crank", (0, 0, 0), (0, 0, 0), CRANK_ARM, "metal")]),
        _link(prefix, "steer_link", [*_fork(g), *_fork_shapes(g)]),
        _link(prefix, "front_wheel_link", _wheel(g.front_radius)),
    ]
    joints = _joints(g, prefix)
    for mount in mounts:
        links.append(_link(prefix, mount.frame, []))
        joints.append(_fixed(prefix, mount))
    materials = [
        f'<material name="{key}"><color rgba="{value}"/></material>'
        for key, value in COLOURS.items()
    ]
    inner = "\n  ".join([*materials, *links, *joints])
    return f'<?xml version="1.0"?>\n<robot name="{html.escape(name)}">\n  {inner}\n</robot>\n'


def _joints(g: Geometry, prefix: str) -> list[str]:
    tilt, axle, front = g.steer_axis_tilt, (0.0, 0.0, g.rear_radius), wheel_in_steer(g)
    return [
        _joint(prefix, "lean", FOOTPRINT, "base_link", (0, 0, 0), 0.0, "1 0 0", 1.6),
        _joint(prefix, "rear_wheel", "base_link", "rear_wheel_link", axle, 0.0, "0 1 0"),
        _joint(prefix, "crank", "base_link", "crank_link", crank(g), 0.0, "0 1 0"),
        _joint(prefix, "steer", "base_link", "steer_link", head(g), -tilt, "0 0 1", g.steer_stop),
        _joint(prefix, "front_wheel", "steer_link", "front_wheel_link", front, 0.0, "0 1 0"),
    ]


def _saddle(g: Geometry) -> Point:
    return 0.28 * g.wheelbase, 0.0, SADDLE_HEIGHT


def _crown(g: Geometry) -> float:
    """Return where the fork's blades meet, above the tyre: z in steer_link, m."""
    x, _, z = wheel_in_steer(g)
    clear = 1.06 * g.front_radius + 0.01
    return min(-0.02, z + math.sqrt(max(clear * clear - x * x, 0.0)))


def _on_axis(g: Geometry, along: float) -> Point:
    """Return the place in base_link of a z of steer_link, m."""
    x, _, z = head(g)
    return x - along * math.sin(g.steer_axis_tilt), 0.0, z + along * math.cos(g.steer_axis_tilt)


def _frame(g: Geometry) -> Iterator[str]:
    """Yield the tubes of base_link, and the saddle."""
    low, saddle = crank(g), _saddle(g)
    post = _between(low, saddle, 0.96)
    cluster = _between(low, saddle, 0.78)
    bottom, top = _crown(g) + 0.015, 0.06
    yield _tube(low, cluster, 0.017, "frame")
    yield _tube(cluster, post, 0.013, "metal")
    yield _tube(_on_axis(g, bottom), _on_axis(g, top), 0.021, "frame")
    yield _tube(low, _on_axis(g, bottom + 0.03), 0.019, "frame")
    yield _tube(_between(low, saddle, 0.74), _on_axis(g, top - 0.03), 0.016, "frame")
    yield _tube((low[0], -0.04, low[2]), (low[0], 0.04, low[2]), 0.022, "frame")
    for side in (1.0, -1.0):
        axle = 0.0, 0.065 * side, g.rear_radius
        yield _tube(axle, (low[0], 0.025 * side, low[2]), 0.009, "frame")
        yield _tube(axle, (cluster[0], 0.012 * side, cluster[2]), 0.008, "frame")
    yield _mesh("saddle", saddle, (0, 0, 0), 0.27, "dark")


def _fork(g: Geometry) -> Iterator[str]:
    """Yield fork and handlebar in steer_link."""
    crown, (x, _, z) = _crown(g), wheel_in_steer(g)
    yield _tube((0.0, 0.0, crown), (0.0, 0.0, STEM), 0.013, "metal")
    yield _tube((0.0, -0.06, crown), (0.0, 0.06, crown), 0.016, "frame")
    length = math.hypot(x, z - crown)
    turn = 0.0, math.atan2(x, z - crown), 0.0
    for side in (1.0, -1.0):
        at = 0.0, 0.055 * side, crown
        yield _mesh("blade", at, turn, (0.013, 0.013, length), "frame")
    # Level, however far the steering axis leans back.
    level = 0.0, g.steer_axis_tilt, 0.0
    yield _mesh("handlebar", (0.0, 0.0, STEM), level, BAR, "metal")
    yield _mesh("grips", (0.0, 0.0, STEM), level, BAR, "dark")


def _wheel(radius: float) -> list[str]:
    """Return tyre, rim and spokes, whose outer radius is the wheel's; nothing without a radius."""
    if radius <= 0.0:
        return []
    disc = f'<cylinder radius="{radius:.5g}" length="0.03"/>'
    return [
        _mesh("tyre", (0, 0, 0), (0, 0, 0), radius, "dark"),
        _mesh("wheel", (0, 0, 0), (0, 0, 0), radius, "metal"),
        _shape("collision", disc, (0, 0, 0), (0.5 * math.pi, 0, 0)),
    ]


def _rider(g: Geometry) -> Iterator[str]:
    """Yield a rider on the saddle who holds the handlebar and rests the feet beside the crank."""
    x, _, z = _saddle(g)
    hip = x - 0.02, 0.0, z + 0.07
    bar = _on_axis(g, STEM)
    hand = bar[0] - 0.5 * BAR, 0.0, bar[2] + 0.02
    lean = _lean_to(hip, hand)
    shoulder = _polar(hip, 0.87 * TORSO, lean)
    yield _mesh("torso", hip, (0.0, lean, 0.0), (0.19, 0.19, TORSO), "shirt")
    yield _mesh("head", _polar(hip, TORSO + 0.13, 0.6 * lean), (0, 0, 0), 0.125, "skin")
    foot = crank(g)
    for side in (1.0, -1.0):
        start, end = _aside(shoulder, 0.18 * side), _aside(hand, 0.97 * BAR * side)
        elbow = _joint_between(start, end, UPPER_ARM, FOREARM, forward=False)
        yield _limb(start, elbow, 0.05, "shirt")
        yield _limb(elbow, end, 0.038, "skin")
        start, end = _aside(hip, 0.09 * side), (foot[0] - 0.05, 0.14 * side, foot[2] - 0.02)
        knee = _joint_between(start, end, THIGH, SHANK, forward=True)
        yield _limb(start, knee, 0.085, "trousers")
        yield _limb(knee, end, 0.058, "trousers")
        toe = end[0] + 0.2, end[1], end[2] - 0.03
        yield _limb((end[0] - 0.06, end[1], end[2] - 0.02), toe, 0.045, "dark")


def _lean_to(hip: Point, hand: Point) -> float:
    """Return how far a torso leans forward until the hands reach, rad."""
    for degrees in range(8, 70):
        x, _, z = _polar(hip, 0.87 * TORSO, math.radians(degrees))
        if math.hypot(hand[0] - x, hand[2] - z) <= ARM_REACH:
            break
    return math.radians(degrees)


def _joint_between(a: Point, b: Point, upper: float, lower: float, forward: bool) -> Point:
    """Return the knee or elbow between two ends, which a straight limb has on its line."""
    dx, dz = b[0] - a[0], b[2] - a[2]
    far = max(math.dist(a, b), 1e-6)
    share = min(upper / (upper + lower), 0.5 * (far**2 + upper**2 - lower**2) / far**2)
    out = math.sqrt(max(upper**2 - (share * far) ** 2, 0.0))
    across = max(math.hypot(dx, dz), 1e-6)
    sign = 1.0 if forward else -1.0
    x, y, z = _between(a, b, share)
    return x - sign * out * dz / across, y, z + sign * out * dx / across


def _body_shapes(g: Geometry) -> Iterator[str]:
    """Yield primitives of frame and rider."""
    low, saddle, axle = crank(g), _saddle(g), (0.0, 0.0, g.rear_radius)
    for a, b in ((axle, low), (axle, saddle), (low, saddle), (low, head(g)), (saddle, head(g))):
        yield _cylinder(a, b, 0.02)
    if g.has_rider:
        hip = saddle[0], 0.0, saddle[2] + 0.07
        yield _cylinder(hip, _polar(hip, TORSO + 0.25, 0.2), 0.16)


def _fork_shapes(g: Geometry) -> Iterator[str]:
    """Yield primitives of fork and handlebar."""
    yield _cylinder(wheel_in_steer(g), (0.0, 0.0, 0.0), 0.02)
    yield _cylinder((0.0, 0.0, 0.0), (0.0, 0.0, STEM), 0.02)
    yield _cylinder((0.0, -BAR, STEM), (0.0, BAR, STEM), 0.015)


def _between(a: Point, b: Point, share: float) -> Point:
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])


def _polar(a: Point, length: float, lean: float) -> Point:
    """Return the point at a length from another one, leaning forward from the vertical."""
    return a[0] + length * math.sin(lean), a[1], a[2] + length * math.cos(lean)


def _aside(a: Point, left: float) -> Point:
    return a[0], a[1] + left, a[2]


def _towards(a: Point, b: Point) -> tuple[float, Point]:
    """Return the distance of two points, and roll, pitch and yaw that turn z from a to b."""
    dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    return math.dist(a, b), (0.0, math.atan2(math.hypot(dx, dy), dz), math.atan2(dy, dx))


def _tube(a: Point, b: Point, radius: float, colour: str) -> str:
    length, turn = _towards(a, b)
    return _mesh("tube", a, turn, (radius, radius, length), colour)


def _limb(a: Point, b: Point, radius: float, colour: str) -> str:
    """Return a limb whose round ends reach beyond both points."""
    length, turn = _towards(a, b)
    more = 0.5 * radius / max(length, 1e-6)
    return _mesh(
        "limb", _between(a, b, -more), turn, (radius, radius, length * (1.0 + 2.0 * more)), colour
    )


def _cylinder(a: Point, b: Point, radius: float) -> str:
    length, turn = _towards(a, b)
    shape = f'<cylinder radius="{radius:.5g}" length="{length:.5g}"/>'
    return _shape("collision", shape, _between(a, b, 0.5), turn)


def _mesh(
    name: str, at: Point, turn: Point, scale: float | tuple[float, float, float], colour: str
) -> str:
    """Return a mesh of a colour; scale: m per unit, of all or of x, y and z."""
    sizes = scale if isinstance(scale, tuple) else (scale, scale, scale)
    shape = f'<mesh filename="{MESHES}/{name}.stl" scale="{_words(sizes)}"/>'
    return _shape("visual", shape, at, turn, f'<material name="{colour}"/>')


def _shape(kind: str, geometry: str, at: Point, turn: Point, material: str = "") -> str:
    origin = f'<origin xyz="{_words(at)}" rpy="{_words(turn)}"/>'
    return f"<{kind}>{origin}<geometry>{geometry}</geometry>{material}</{kind}>"


def _words(values: Sequence[float]) -> str:
    return " ".join(f"{value:.6g}" for value in values)


def _link(prefix: str, name: str, shapes: Sequence[str]) -> str:
    return f'<link name="{prefix}{name}">{"".join(shapes)}</link>'


def _joint(
    prefix: str,
    name: str,
    parent: str,
    child: str,
    at: Point,
    pitch: float,
    axis: str,
    limit: float | None = None,
) -> str:
    """Return a joint that turns without end, or up to a limit to both sides, rad."""
    kind, bound = "continuous", ""
    if limit is not None:
        kind = "revolute"
        bound = f'<limit lower="{-limit:.5g}" upper="{limit:.5g}" effort="100" velocity="100"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{prefix}{parent}"/>'
        f'<child link="{prefix}{child}"/><origin xyz="{_words(at)}" rpy="0 {pitch:.6g} 0"/>'
        f'<axis xyz="{axis}"/>{bound}</joint>'
    )


def _fixed(prefix: str, mount: Mount) -> str:
    return (
        f'<joint name="{mount.frame}" type="fixed"><parent link="{prefix}base_link"/>'
        f'<child link="{prefix}{mount.frame}"/>'
        f'<origin xyz="{_words(mount.position)}" rpy="{_words(mount.angles)}"/></joint>'
    )
