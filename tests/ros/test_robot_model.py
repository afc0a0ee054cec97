"""Transforms and URDF: they agree with each other and with the state."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from probe import Probe

from bicycle_common.nodes import topics
from bicycle_common.types import InitialPose
from bicycle_sim.nodes import robot_model, robot_urdf
from bicycle_sim.nodes.visualization import JOINTS, Joints
from bicycle_sim.plants import registry
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.sensors import settings
from bicycle_sim.task.scenario import named

WHIPPLE = registry.named(plant="whipple", bicycle="browser-rider")


def matrix(transform: Any) -> np.ndarray:
    """A transform message as a 4 by 4 matrix."""
    q, t = transform.rotation, transform.translation
    x, y, z, w = q.x, q.y, q.z, q.w
    assert x * x + y * y + z * z + w * w == pytest.approx(1.0)
    transform = np.eye(4)
    transform[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    transform[:3, 3] = t.x, t.y, t.z
    return transform


def chain(message: Any, last: str) -> np.ndarray:
    """The pose of a frame in odom."""
    found = {one.child_frame_id: one for one in message.transforms}
    transform, frame = np.eye(4), last
    while frame in found:
        transform = matrix(found[frame].transform) @ transform
        frame = found[frame].header.frame_id
    assert frame.endswith("odom")
    return transform


@pytest.mark.parametrize("plant", [registry.default(), WHIPPLE], ids=["choi", "whipple"])
def test_the_wheels_stand_where_the_contacts_are(plant: Any) -> None:
    simulator, g = Simulator(named("learned-speed"), plant), plant.geometry
    simulator.reset(InitialPose(3.0, 4.0, 0.7, 3.0))
    message = robot_model.transforms(simulator.snapshot, 5, g, "", 1.0)
    state = simulator.snapshot
    rear, front = chain(message, "rear_wheel_link"), chain(message, "front_wheel_link")
    assert rear[:3, 3] == pytest.approx([state.rear_x, state.rear_y, g.rear_radius])
    assert front[:3, 3] == pytest.approx([state.front_x, state.front_y, g.front_radius], abs=1e-6)


def test_lean_and_steering_turn_their_links_to_the_left() -> None:
    simulator, g = Simulator(named("learned-speed"), WHIPPLE), WHIPPLE.geometry
    simulator.reset(InitialPose(0.0, 0.0, -math.pi / 2, 3.0))
    state = replace(simulator.snapshot, lean_angle=0.2, steer_angle=0.3)
    message = robot_model.transforms(state, 5, g, "", 0.0)
    up = chain(message, "base_link")[:3, 2]
    assert up == pytest.approx([0.0, math.sin(0.2), math.cos(0.2)], abs=1e-9)
    upright = robot_model.transforms(replace(state, lean_angle=0.0), 5, g, "", 0.0)
    axle = chain(upright, "front_wheel_link")[:3, 1]
    assert axle[0] < -0.2  # the wheel points to the left, so its left side looks back


def test_wheels_without_size_do_not_turn() -> None:
    skate = registry.named(plant="whipple", bicycle="two-mass-skate")
    simulator = Simulator(named("learned-speed"), skate)
    simulator.reset(InitialPose(0.0, 0.0, 0.0, 3.0))
    message = robot_model.transforms(simulator.snapshot, 5, skate.geometry, "", 1.0)
    turns = {one.child_frame_id: one.transform.rotation.w for one in message.transforms}
    assert turns["rear_wheel_link"] == turns["front_wheel_link"] == turns["crank_link"] == 1.0
    joints = Joints(skate.geometry, skate.time_step)
    joints.advance(simulator.snapshot)
    assert list(joints.message(simulator.snapshot, 5).position) == [0.0] * len(JOINTS)


def test_the_urdf_has_the_tree_and_the_joints_of_the_messages() -> None:
    g = WHIPPLE.geometry
    root = ElementTree.fromstring(robot_urdf.urdf(g, 'a "bicycle" & more', "b1/"))
    links = {link.attrib["name"] for link in root.findall("link")}
    joints = {joint.attrib["name"]: joint for joint in root.findall("joint")}
    assert set(JOINTS) <= set(joints)
    simulator = Simulator(named("learned-speed"), WHIPPLE)
    simulator.reset(InitialPose(0.0, 0.0, 0.0, 3.0))
    message = robot_model.transforms(simulator.snapshot, 5, g, "b1/", 0.0)
    frames = {one.child_frame_id for one in message.transforms}
    assert links == frames
    assert all(name.startswith("b1/") for name in frames)
    places = {one.child_frame_id: one.transform.translation for one in message.transforms}
    for joint in joints.values():
        child = joint.find("child")
        origin = joint.find("origin")
        assert child is not None
        assert origin is not None
        position = [float(word) for word in origin.attrib["xyz"].split()]
        place = places[child.attrib["link"]]
        assert position == pytest.approx([place.x, place.y, place.z], abs=1e-5)
    static = robot_model.static_transforms("b1/", 0).transforms[0]
    assert (static.header.frame_id, static.child_frame_id) == ("map", "b1/odom")
    assert robot_model.frames_of("/b1") == "b1/"
    assert robot_model.frames_of("/") == ""


def test_sensors_have_their_mounts_in_tree_and_model() -> None:
    imu = replace(settings.load("mpu6050-rtk").imu, position=(0.1, 0.2, 0.3), mounting=(90, 0, 90))
    mounts = robot_model.mounts_of(replace(settings.load("mpu6050-rtk"), imu=imu))
    _, mounted, antenna = robot_model.static_transforms("b1/", 0, mounts).transforms
    assert (mounted.header.frame_id, mounted.child_frame_id) == ("b1/base_link", "b1/imu_link")
    assert (antenna.header.frame_id, antenna.child_frame_id) == ("b1/base_link", "b1/gnss_link")
    place, turn = mounted.transform.translation, mounted.transform.rotation
    assert (place.x, place.y, place.z) == (0.1, 0.2, 0.3)
    # Half a right angle each about roll, then yaw: x goes to y, y to z, z to x.
    assert [turn.w, turn.x, turn.y, turn.z] == pytest.approx([0.5] * 4)
    root = ElementTree.fromstring(robot_urdf.urdf(WHIPPLE.geometry, "b", "b1/", mounts))
    origin = root.find("joint[@name='imu_link']/origin")
    assert origin is not None
    assert origin.attrib == {"xyz": "0.1 0.2 0.3", "rpy": "1.5708 0 1.5708"}
    assert robot_model.mounts_of(None) == ()


@pytest.mark.ros
def test_a_node_in_a_namespace_publishes_tree_and_model(start_node: Any, ros_domain: int) -> None:
    sim = start_node("bicycle_sim.nodes.sim_node", ["--ros-args", "-r", "__ns:=/b1"])
    sim.wait_for_line("episode 1 waits")
    probe = Probe(
        ros_domain,
        topics.TF,
        topics.TF_STATIC,
        topics.ROBOT_DESCRIPTION,
        topics.ODOMETRY,
        namespace="/b1",
    )
    try:
        probe.spin_until(lambda: probe[topics.TF] and probe[topics.ROBOT_DESCRIPTION])
        probe.spin_until(lambda: probe[topics.TF_STATIC] and probe[topics.ODOMETRY])
        odometry = probe[topics.ODOMETRY][0]
        assert (odometry.header.frame_id, odometry.child_frame_id) == ("b1/odom", "b1/base_link")
        assert odometry.twist.covariance[35] > 0.0
        names = {one.child_frame_id for one in probe[topics.TF][0].transforms}
        root = ElementTree.fromstring(probe[topics.ROBOT_DESCRIPTION][0].data)
        assert names == {link.attrib["name"] for link in root.findall("link")}
        assert probe[topics.TF_STATIC][0].transforms[0].child_frame_id == "b1/odom"
    finally:
        probe.close()
