"""The bicycle as other tools see it: odometry against a ride's own geometry."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from geometry_msgs.msg import Quaternion, Twist
from visualization_msgs.msg import Marker

from bicycle_common.nodes import convert
from bicycle_common.types import BicycleState, Command, InitialPose
from bicycle_sim.nodes.visualization import JOINTS, Joints, markers, numbers, odometry
from bicycle_sim.plants import registry
from bicycle_sim.plants.choi.parameters import Constants
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named

pytestmark = pytest.mark.ros

DT = Constants().time_step


def ride(torque: float) -> list[BicycleState]:
    """Steer to one side for a second, from a heading that is none of the axes."""
    simulator = Simulator(named("random-start-random-goal"))
    simulator.reset(InitialPose(1.0, 2.0, 0.7, 10.0 / 3.6))
    states = [simulator.snapshot]
    for _ in range(40):
        command = Command(1, simulator.snapshot.step, torque, 0.0, 0.0)
        states.append(simulator.step(command))
    return states


def rotation(turn: Quaternion) -> np.ndarray:
    """Return the matrix of a unit quaternion, (3, 3)."""
    w, x, y, z = turn.w, turn.x, turn.y, turn.z
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@pytest.mark.parametrize("torque", [0.05, -0.05])
def test_odometry_turns_the_way_the_bicycle_does(torque: float) -> None:
    """Each component and its sign, from the contacts of the wheels and from the lean."""
    states = ride(torque)
    assert abs(states[-1].lean_angle) > 0.05, "the bicycle leans, or the roll would not be tested"
    for state in states:
        turned = rotation(odometry(state, 0).pose.pose.orientation)
        along = np.array([state.front_x - state.rear_x, state.front_y - state.rear_y, 0.0])
        along /= np.linalg.norm(along)
        left = np.array([-along[1], along[0], 0.0])
        up = np.array([0.0, 0.0, 1.0])
        # The bicycle's own axes in the world: it leans to the left for a lean above zero.
        lean = state.lean_angle
        np.testing.assert_allclose(turned @ [1, 0, 0], along, atol=1e-9)
        np.testing.assert_allclose(
            turned @ [0, 0, 1], math.cos(lean) * up + math.sin(lean) * left, atol=1e-9
        )


@pytest.mark.parametrize("torque", [0.05, -0.05])
def test_odometrys_rates_are_those_of_its_pose(torque: float) -> None:
    """REP-103: roll to the right and yaw to the left are above zero, in rates as in angles."""
    for before, after in pairwise(ride(torque)[20:]):
        twist = odometry(after, 0).twist.twist
        roll_rate = -(after.lean_angle - before.lean_angle) / DT
        yaw = [convert.yaw_of(state) for state in (before, after)]
        yaw_rate = math.remainder(yaw[1] - yaw[0], 2.0 * math.pi) / DT
        assert abs(roll_rate) > 0.01
        assert abs(yaw_rate) > 0.01
        assert twist.angular.x == pytest.approx(roll_rate, rel=0.05)
        # The twist is that of base_link, which leans: the vertical yaw rate has two parts there.
        roll = -after.lean_angle
        assert twist.angular.z == pytest.approx(yaw_rate * math.cos(roll), rel=0.1)
        assert twist.angular.y == pytest.approx(yaw_rate * math.sin(roll), rel=0.1, abs=1e-6)
        assert twist.linear.x == after.speed


def test_a_bicycle_that_lies_or_is_held_has_no_twist() -> None:
    state = ride(0.05)[-1]
    joints = Joints(registry.default().geometry, DT)
    assert state.speed > 2.0
    assert joints.message(state, 0).velocity[2] > 2.0
    lies = replace(state, fallen=True)
    for twist in (odometry(lies, 0).twist.twist, odometry(state, 0, moving=False).twist.twist):
        assert twist == Twist()
    for message in (joints.message(lies, 0), joints.message(state, 0, moving=False)):
        assert list(message.velocity) == [0.0] * len(JOINTS)


def test_markers_tell_the_angles_in_degrees_and_to_which_side() -> None:
    state = replace(ride(0.0)[0], lean_angle=math.radians(-3.14), steer_angle=math.radians(1.26))
    assert numbers(state) == "lean 3.1° right\nsteering 1.3° left\n2.8 m/s"
    assert numbers(replace(state, lean_angle=-1e-6)).startswith("lean 0.0°\n")
    assert numbers(replace(state, fallen=True)) == "fallen"
    drawn = markers(state, 0, registry.default().geometry, "b1/").markers
    assert {one.header.frame_id for one in drawn} == {"b1/odom"}
    (words,) = [one for one in drawn if one.type == Marker.TEXT_VIEW_FACING]
    assert words.text == numbers(state)
    assert (words.pose.position.x, words.pose.position.y) == (state.rear_x, state.rear_y)
