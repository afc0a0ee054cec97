"""The URDF's meshes: what they are, where they are installed, and how large they are drawn."""

from __future__ import annotations

import math
import os
import struct
import xml.etree.ElementTree as ElementTree
from collections import Counter
from functools import cache
from pathlib import Path

import make_meshes
import numpy as np
import pytest

from bicycle_sim.nodes import robot_urdf
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Geometry
from bicycle_sim.plants.whipple import catalogue

SOURCES = Path(__file__).parents[2] / "bicycle_sim" / "meshes"
RIDDEN = {
    "choi": registry.default().geometry,
    **{name: registry.named(plant="whipple", bicycle=name).geometry for name in catalogue.names()},
}
FEW = pytest.mark.parametrize("name", ["choi", "browser-rider", "pista", "yellow-reversed"])


def corners(data: bytes) -> np.ndarray:
    """Return the triangles of a binary STL, (N, 3, 3), after a look at its normals."""
    (count,) = struct.unpack_from("<I", data, 80)
    assert len(data) == 84 + 50 * count
    assert not data.startswith(b"solid")
    kind = np.dtype([("numbers", "<f4", (4, 3)), ("attribute", "<u2")])
    numbers = np.frombuffer(data, kind, count, 84)["numbers"].astype(float)
    assert np.isfinite(numbers).all()
    assert np.linalg.norm(numbers[:, 0], axis=1) == pytest.approx(1.0, abs=1e-4)
    found = numbers[:, 1:]
    across = np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])
    assert (np.einsum("ij,ij->i", across, numbers[:, 0]) > 0.0).all()
    return found


@cache
def mesh(name: str) -> np.ndarray:
    return corners((SOURCES / name).read_bytes())


@pytest.mark.parametrize("name", sorted(make_meshes.MESHES))
def test_a_mesh_is_closed_looks_outward_and_is_what_the_script_makes(name: str) -> None:
    path = SOURCES / f"{name}.stl"
    assert path.stat().st_size < 100_000
    found = mesh(path.name)
    wanted = corners(make_meshes.stl(make_meshes.MESHES[name]()))
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-5)
    # Each edge of a closed surface is the edge of another triangle, in the other direction.
    points = [[tuple(corner) for corner in triangle] for triangle in np.round(found, 6).tolist()]
    edges = Counter((t[i], t[(i + 1) % 3]) for t in points for i in range(3))
    assert edges == Counter({(b, a): count for (a, b), count in edges.items()})
    assert make_meshes.volume(found) > 0.0


def test_no_mesh_is_left_over() -> None:
    assert {path.stem for path in SOURCES.iterdir()} == set(make_meshes.MESHES)
    used = {name for g in RIDDEN.values() for name in files(document(g))}
    assert {name.removesuffix(".stl") for name in used} == set(make_meshes.MESHES)


def document(g: Geometry) -> ElementTree.Element:
    return ElementTree.fromstring(robot_urdf.urdf(g, "bicycle", ""))


def files(root: ElementTree.Element) -> list[str]:
    """Return the names of the meshes' files, in order."""
    names = [one.attrib["filename"] for one in root.iter("mesh")]
    assert all(name.startswith("package://bicycle_sim/meshes/") for name in names)
    return [name.rpartition("/")[2] for name in names]


@FEW
def test_every_mesh_is_in_the_installed_package(name: str) -> None:
    prefixes = [Path(one) for one in os.environ["AMENT_PREFIX_PATH"].split(os.pathsep)]
    share = next(p / "share/bicycle_sim" for p in prefixes if (p / "share/bicycle_sim").is_dir())
    for file in files(document(RIDDEN[name])):
        assert (share / "meshes" / file).read_bytes() == (SOURCES / file).read_bytes()


def placed(origin: ElementTree.Element | None) -> np.ndarray:
    """Return an origin as a 4 by 4 matrix."""
    assert origin is not None
    roll, pitch, yaw = map(float, origin.attrib["rpy"].split())
    matrix = np.eye(4)
    for axis, angle in ((2, yaw), (1, pitch), (0, roll)):
        turn, i, j = np.eye(4), (axis + 1) % 3, (axis + 2) % 3
        turn[i, i] = turn[j, j] = math.cos(angle)
        turn[j, i] = math.sin(angle)
        turn[i, j] = -math.sin(angle)
        matrix = matrix @ turn
    matrix[:3, 3] = [float(word) for word in origin.attrib["xyz"].split()]
    return matrix


def drawn(root: ElementTree.Element) -> dict[str, list[tuple[str, np.ndarray]]]:
    """Return file and points of each mesh by link, in base_footprint with straight joints."""
    joints = {}
    for joint in root.findall("joint"):
        child, parent = joint.find("child"), joint.find("parent")
        assert child is not None
        assert parent is not None
        joints[child.attrib["link"]] = parent.attrib["link"], placed(joint.find("origin"))

    def pose(link: str) -> np.ndarray:
        return pose(joints[link][0]) @ joints[link][1] if link in joints else np.eye(4)

    found: dict[str, list[tuple[str, np.ndarray]]] = {}
    for link in root.findall("link"):
        name = link.attrib["name"]
        for visual in link.findall("visual"):
            one = visual.find("geometry/mesh")
            assert one is not None
            scale = np.array([float(word) for word in one.attrib["scale"].split()])
            assert (scale > 0.0).all()
            file = one.attrib["filename"].rpartition("/")[2]
            matrix = pose(name) @ placed(visual.find("origin"))
            points = mesh(file).reshape(-1, 3) * scale
            found.setdefault(name, []).append((file, points @ matrix[:3, :3].T + matrix[:3, 3]))
    return found


@FEW
def test_the_model_has_the_sizes_of_the_bicycle(name: str) -> None:
    g = RIDDEN[name]
    links = drawn(document(g))
    for link, middle, radius in (
        ("rear_wheel_link", (0.0, 0.0, g.rear_radius), g.rear_radius),
        ("front_wheel_link", (g.wheelbase, 0.0, g.front_radius), g.front_radius),
    ):
        points = np.concatenate([points for _, points in links[link]]) - middle
        assert np.abs(points[:, 1]).max() < 0.08
        # The tyre is a polygon, which lies within its circle.
        assert np.hypot(points[:, 0], points[:, 2]).max() == pytest.approx(radius, abs=1e-3)
        assert points[:, 2].min() == pytest.approx(-radius, abs=2e-3)
        assert {file for file, _ in links[link]} == {"tyre.stl", "wheel.stl"}
    every = np.concatenate([points for meshes in links.values() for _, points in meshes])
    assert every[:, 2].min() == pytest.approx(0.0, abs=2e-3)
    assert every[:, 0].min() == pytest.approx(-g.rear_radius, abs=2e-3)
    assert every[:, 0].max() == pytest.approx(g.wheelbase + g.front_radius, abs=2e-3)
    height = every[:, 2].max()
    assert 1.6 < height < 2.0 if g.has_rider else height < 1.25


@FEW
def test_fork_blades_lead_to_the_axle_and_hands_to_the_grips(name: str) -> None:
    g = RIDDEN[name]
    links = drawn(document(g))
    blades = [points for file, points in links["steer_link"] if file == "blade.stl"]
    assert len(blades) == 2
    for points in blades:
        lowest = points[points[:, 2].argmin()]
        assert math.hypot(lowest[0] - g.wheelbase, lowest[2] - g.front_radius) < 0.02
        clear = np.abs(points[:, 1]).min()
        assert 0.02 < clear < 0.06  # beside the tyre
    if g.has_rider:
        (grips,) = (points for file, points in links["steer_link"] if file == "grips.stl")
        arms = [points for file, points in links["base_link"] if file == "limb.stl"]
        for side in (1.0, -1.0):
            grip = grips[grips[:, 1] * side > 0.0].mean(axis=0)
            near = min(np.linalg.norm(points - grip, axis=1).min() for points in arms)
            assert near < 0.06


@pytest.mark.parametrize("name", RIDDEN)
def test_every_bicycle_of_the_catalogue_has_a_model(name: str) -> None:
    g = RIDDEN[name]
    root = document(g)
    for meshes in drawn(root).values():
        assert all(np.isfinite(points).all() for _, points in meshes)
    assert ("torso.stl" in files(root)) is (name == "choi" or "rider" in name or g.mass > 90.0)
    # A viewer without the package draws these.
    for link in ("base_link", "steer_link"):
        assert root.find(f"link[@name='{link}']/collision/geometry/cylinder") is not None
    assert (root.find("link[@name='rear_wheel_link']/collision") is not None) is (
        g.rear_radius > 0.0
    )
