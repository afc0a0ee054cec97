"""Make the meshes of the bicycle's URDF anew: binary STL in bicycle_sim/meshes.

    . tests/env.sh
    python tests/tools/make_meshes.py

`robot_urdf.py` scales and places them by the parameters of the ridden bicycle, so one set serves
all. Wheels and limbs have unit size; x is forward, y to the left, z up. Every part is a closed
surface whose triangles look outward.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).resolve().parents[2] / "bicycle_sim" / "meshes"
SPOKES = 28
TEETH = 36

Triangles = np.ndarray
"""(N, 3, 3): corners of N triangles."""


def loft(rings: Sequence[np.ndarray], closed: bool = False) -> Triangles:
    """Return the surface through rings of equally many points.

    Args:
        rings: each (K, 3), in order around the same axis.
        closed: True if the last ring joins the first; else fans close both ends.
    """
    points = np.array(rings, dtype=float)
    following = np.roll(points, -1, axis=0) if closed else points[1:]
    first = points if closed else points[:-1]
    a, b = first, np.roll(first, -1, axis=1)
    c, d = np.roll(following, -1, axis=1), following
    sides = [np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]
    parts = [side.reshape(-1, 3, 3) for side in sides]
    for end, turn in () if closed else ((0, 1), (-1, -1)):
        ring = points[end]
        middle = np.broadcast_to(ring.mean(axis=0), ring.shape)
        parts.append(np.stack([middle, np.roll(ring, -1, axis=0), ring][::turn], axis=1))
    surface = np.concatenate(parts)
    return surface if volume(surface) > 0.0 else surface[:, ::-1]


def volume(surface: Triangles) -> float:
    """Return the enclosed volume, positive if the triangles look outward."""
    return float(np.einsum("ij,ij->", surface[:, 0], np.cross(surface[:, 1], surface[:, 2])) / 6.0)


def circle(sides: int, radius: float = 1.0, x: float = 0.0, z: float = 0.0) -> np.ndarray:
    """Return points of a circle about z whose middle is at (x, 0, z), (sides, 3)."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    return np.column_stack([x + radius * np.cos(angle), radius * np.sin(angle), np.full(sides, z)])


def turned(profile: np.ndarray, sides: int) -> Triangles:
    """Return the ring that a profile sweeps about y; profile (K, 2) of radius and y."""
    rings = []
    for angle in 2.0 * np.pi * np.arange(sides) / sides:
        radius, y = profile.T
        rings.append(np.column_stack([radius * np.sin(angle), y, radius * np.cos(angle)]))
    return loft(rings, closed=True)


def swept(line: np.ndarray, radii: Sequence[float] | np.ndarray, sides: int = 12) -> Triangles:
    """Return a tube of changing radius along a line (K, 3)."""
    tangents = np.gradient(line, axis=0)
    side = np.array([1.0, 0.0, 0.0])
    if abs(tangents[0] @ side) > 0.9 * np.linalg.norm(tangents[0]):
        side = np.array([0.0, 1.0, 0.0])
    rings = []
    for point, tangent, radius in zip(line, tangents, radii, strict=True):
        along = tangent / np.linalg.norm(tangent)
        side = side - along * (side @ along)
        side = side / np.linalg.norm(side)
        x, y, _ = (radius * circle(sides)).T
        rings.append(point + np.outer(x, side) + np.outer(y, np.cross(along, side)))
    return loft(rings)


def tyre() -> Triangles:
    """Return a tyre of outer radius 1 about y."""
    angle = 2.0 * np.pi * np.arange(10) / 10
    thick = 0.052
    return turned(
        np.column_stack([1.0 - thick + thick * np.cos(angle), thick * np.sin(angle)]), 60
    )


def wheel() -> Triangles:
    """Return rim, spokes and hub for a tyre of outer radius 1, about y."""
    rim = np.array([(0.86, 0.0), (0.88, -0.034), (0.925, -0.034), (0.925, 0.034), (0.88, 0.034)])
    parts = [turned(rim, 60)]
    hub = [(0.02, 0.17), (0.06, 0.14), (0.06, 0.12), (0.035, 0.115)]
    outline = [*((r, -y) for r, y in hub), *((r, y) for r, y in reversed(hub))]
    parts.append(loft([_upright(r, y) for r, y in outline]))
    for number in range(SPOKES):
        # As on a real wheel: left and right in turn, and each flange's in crossing pairs.
        y, ahead = (0.12 if number % 2 else -0.12), (0.9 if number // 2 % 2 else -0.9)
        at_rim = 2.0 * np.pi * number / SPOKES
        at_hub = at_rim + ahead
        ends = [(0.055, at_hub, y), (0.87, at_rim, 0.0)]
        line = np.array([(r * np.sin(a), y, r * np.cos(a)) for r, a, y in ends])
        parts.append(swept(line, (0.006, 0.006), sides=4))
    return np.concatenate(parts)


def _upright(radius: float, y: float) -> np.ndarray:
    """Return a circle about y."""
    x, z, _ = circle(20, radius).T
    return np.column_stack([x, np.full(len(x), y), z])


def tube() -> Triangles:
    """Return a tube of radius 1 from z = 0 to 1, with bevelled ends."""
    places, radii = (0.0, 0.004, 0.996, 1.0), (0.8, 1.0, 1.0, 0.8)
    rings = [circle(20, r, z=z) for z, r in zip(places, radii, strict=True)]
    return loft(rings)


def blade() -> Triangles:
    """Return a fork blade from z = 0, of radius 1, to z = 1, thinner and bowed towards x."""
    z = np.linspace(0.0, 1.0, 13)
    bow = 2.0 * np.sin(np.pi * z) * z
    rings = [circle(14, 1.0 - 0.5 * h, b, h) for h, b in zip(z, bow, strict=True)]
    return loft(rings)


def handlebar() -> Triangles:
    """Return a swept-back bar whose grips end at y = -1 and 1."""
    return swept(_bar(np.linspace(-1.0, 1.0, 41)), np.full(41, 0.04))


def grips() -> Triangles:
    """Return the two grips of the bar."""
    return np.concatenate(
        [swept(_bar(s * np.linspace(0.62, 1.02, 9)), np.full(9, 0.058)) for s in (-1.0, 1.0)]
    )


def _bar(y: np.ndarray) -> np.ndarray:
    """Return the middle line of the bar at places to the left, (K, 3): it bends towards -x."""
    out = np.clip((np.abs(y) - 0.3) / 0.7, 0.0, None)
    return np.column_stack(
        [-0.55 * out**1.5, y, 0.12 * np.exp(-(((np.abs(y) - 0.45) / 0.22) ** 2))]
    )


def saddle() -> Triangles:
    """Return a saddle of length 1 from x = -0.5 to 0.5, whose top is at z = 0."""
    x = np.array([-0.5, -0.47, -0.38, -0.25, -0.1, 0.1, 0.3, 0.45, 0.5])
    half = np.array([0.05, 0.2, 0.28, 0.26, 0.18, 0.1, 0.07, 0.06, 0.02])
    deep = np.array([0.04, 0.1, 0.12, 0.11, 0.09, 0.08, 0.07, 0.06, 0.03])
    rise = np.array([-0.02, 0.0, 0.0, -0.01, -0.02, -0.02, -0.02, -0.03, -0.06])
    rings = []
    for one in zip(x, half, deep, rise, strict=True):
        at, wide, thick, top = one
        across, up, _ = circle(16).T
        rings.append(
            np.column_stack([np.full(16, at), wide * across, top - 0.5 * thick * (1.0 - up)])
        )
    return loft(rings)


def crank() -> Triangles:
    """Return chainring, arms of length 1 and pedals about y; the left pedal hangs down."""
    angle = np.pi * np.arange(2 * TEETH) / TEETH
    radius = np.where(np.arange(2 * TEETH) % 2, 0.55, 0.6)
    ring = [
        np.column_stack([radius * np.sin(angle), np.full(2 * TEETH, y), radius * np.cos(angle)])
        for y in (-0.27, -0.24)
    ]
    axle = swept(np.array([(0.0, -0.45, 0.0), (0.0, 0.45, 0.0)]), (0.09, 0.09))
    parts = [loft(ring), axle]
    for side in (1.0, -1.0):  # left down, right up
        parts.append(_box((0.0, 0.42 * side, -0.5 * side), (0.13, 0.08, 1.1)))
        parts.append(_box((0.0, 0.75 * side, -1.0 * side), (0.5, 0.5, 0.12)))
    return np.concatenate(parts)


def _box(middle: tuple[float, float, float], size: tuple[float, float, float]) -> Triangles:
    square = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
    rings = [np.column_stack([square, np.full(4, z)]) for z in (-0.5, 0.5)]
    return loft([ring * size + middle for ring in rings])


def limb() -> Triangles:
    """Return a limb from z = 0 to 1: round ends, radius 1 at its thickest and thinner below."""
    z = np.array([0.0, 0.01, 0.04, 0.12, 0.3, 0.5, 0.7, 0.88, 0.96, 0.99, 1.0])
    radii = np.array([0.1, 0.45, 0.72, 0.9, 1.0, 0.94, 0.82, 0.72, 0.62, 0.36, 0.08])
    return loft([circle(14, r, z=h) for h, r in zip(z, radii, strict=True)])


def torso() -> Triangles:
    """Return a trunk from the hips, z = 0, to the neck, z = 1; shoulders from y = -1 to 1."""
    z = np.array([-0.12, -0.08, 0.0, 0.15, 0.4, 0.65, 0.82, 0.9, 0.95, 1.0, 1.06])
    wide = np.array([0.25, 0.6, 0.78, 0.74, 0.7, 0.85, 0.98, 1.0, 0.72, 0.28, 0.26])
    deep = np.array([0.2, 0.48, 0.6, 0.52, 0.48, 0.55, 0.55, 0.45, 0.36, 0.28, 0.26])
    rings = []
    for height, across, through in zip(z, wide, deep, strict=True):
        x, y, _ = circle(20).T
        rings.append(np.column_stack([through * x, across * y, np.full(20, height)]))
    return loft(rings)


def head() -> Triangles:
    """Return a head of height 2 about its middle, narrower to the sides."""
    angle = np.linspace(0.0, np.pi, 11)
    rings = []
    for one in angle:
        x, y, _ = circle(18, max(float(np.sin(one)), 0.02)).T
        rings.append(np.column_stack([0.8 * x, 0.66 * y, np.full(18, np.cos(one))]))
    return loft(rings)


MESHES: dict[str, Callable[[], Triangles]] = {
    "blade": blade,
    "crank": crank,
    "grips": grips,
    "handlebar": handlebar,
    "head": head,
    "limb": limb,
    "saddle": saddle,
    "torso": torso,
    "tube": tube,
    "tyre": tyre,
    "wheel": wheel,
}
"""Maker of each file."""


def stl(surface: Triangles) -> bytes:
    """Return triangles as binary STL; its header may not begin with "solid", as texts do."""
    corners = surface.astype("<f4")
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    kind = np.dtype([("numbers", "<f4", (4, 3)), ("attribute", "<u2")])
    rows = np.zeros(len(corners), kind)
    rows["numbers"][:, 0], rows["numbers"][:, 1:] = normals, corners
    return b"self-driving bicycle".ljust(80) + struct.pack("<I", len(rows)) + rows.tobytes()


def main() -> None:
    """Write all meshes."""
    FOLDER.mkdir(exist_ok=True)
    for name, make in MESHES.items():
        path = FOLDER / f"{name}.stl"
        path.write_bytes(stl(make()))
        print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
