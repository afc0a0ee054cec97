"""Messages from YAML: every kind of field, and what does not fit."""

from __future__ import annotations

import math

import pytest
from bicycle_msgs.msg import GoalStatus, Transition
from bicycle_msgs.srv import Push, Reset
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry, Path

from bicycle_tools.nodes.filling import FillingError, filled

pytestmark = pytest.mark.ros


def test_values_of_every_kind_get_into_their_fields() -> None:
    status = filled(GoalStatus, "{goal_id: 4294967295, status: 2, message: a, position: {x: 1}}")
    assert (status.goal_id, status.status, status.message) == (2**32 - 1, 2, "a")
    assert isinstance(status.position.x, float)
    assert status.position.x == 1.0
    reset = filled(Reset.Request, "{random_start: true, speed: .nan, seed: -3}")
    assert (reset.random_start, reset.seed, math.isnan(reset.speed)) == (True, -3, True)
    path = filled(Path, "poses: [{pose: {position: {x: 1.5}}}, {header: {frame_id: map}}]")
    assert [pose.header.frame_id for pose in path.poses] == ["", "map"]
    assert path.poses[0].pose.position.x == 1.5
    odometry = filled(Odometry, f"pose: {{covariance: {[1] * 36}}}")
    assert list(odometry.pose.covariance) == [1.0] * 36
    array = filled(DiagnosticArray, "status: [{level: 1, name: a, values: [{key: b, value: c}]}]")
    assert (array.status[0].level, array.status[0].values[0].value) == (b"\x01", "c")
    assert filled(Push.Request, "").lean_rate == 0.0


@pytest.mark.parametrize(
    ("kind", "text", "complaint"),
    [
        (GoalStatus, "goal_id: -1", "goal_id must be a whole number from 0 to 4294967295"),
        (GoalStatus, "status: 256", "status must be a whole number from 0 to 255"),
        (GoalStatus, "goal_id: 1.5", "goal_id must be a whole number"),
        (GoalStatus, "goal_id: true", "goal_id must be a whole number"),
        (GoalStatus, "message: 3", "message must be a text, not 3: put it in quotes"),
        (GoalStatus, "position: 3", "position must be fields"),
        (GoalStatus, "position: {z: a}", "position.z must be a number, not 'a'"),
        (GoalStatus, "positon: {}", "has no field 'positon' (did you mean 'position'?)"),
        (GoalStatus, "{a: b: c}", "is not YAML"),
        (Path, "poses: {}", "poses must be a list"),
        (Path, "poses: [{pose: {positon: {}}}]", "poses[0].pose has no field 'positon'"),
        (Odometry, "pose: {covariance: [1]}", "pose.covariance must have 36 values, not 1"),
        (Transition, "observation: [1, 2]", "observation must have 6 values, not 2"),
        (Push.Request, "lean_rate: 1" + "0" * 400, "is not YAML"),
    ],
)
def test_what_does_not_fit_is_one_line(kind: type, text: str, complaint: str) -> None:
    with pytest.raises(FillingError) as error:
        filled(kind, text)
    assert complaint in str(error.value)
    assert "\n" not in str(error.value)
