"""Poses in JSON from clients of Foxglove's protocol."""

from __future__ import annotations

import contextlib
import json
from typing import Any

import pytest
from busy_machine import UNHURRIED
from hypothesis import given
from hypothesis import strategies as st

from bicycle_tools.foxglove_pose import parse_pose
from bicycle_tools.foxglove_settings import FoxgloveSettings


def pose(**changes: Any) -> dict[str, Any]:
    message: dict[str, Any] = {
        "header": {"seq": 3, "stamp": {"sec": 1, "nsec": 2}, "frame_id": "odom"},
        "pose": {
            "position": {"x": 1, "y": -2.5, "z": 0},
            "orientation": {"x": 0, "y": 0, "z": 0.6, "w": 0.8},
        },
    }
    return {**message, **changes}


def parsed(message: Any) -> Any:
    return parse_pose(json.dumps(message).encode())


def test_a_pose_is_read_whatever_its_stamp_is_called() -> None:
    found = parsed(pose())
    assert found.frame == "odom"
    assert found.position == (1.0, -2.5, 0.0)
    assert found.orientation == (0.0, 0.0, 0.6, 0.8)


def test_a_pose_with_covariance_is_read_too() -> None:
    inner = {"pose": pose()["pose"], "covariance": [0.0] * 36}
    assert parsed(pose(pose=inner)) == parsed(pose())


@pytest.mark.parametrize(
    ("message", "complaint"),
    [
        ([], "no pose"),
        (pose(pose=3), "no pose"),
        (pose(pose={}), "no position"),
        (pose(header=None), "no header"),
        (pose(header={"frame_id": 3}), "frame_id is not a text"),
        (pose(pose={"position": {"x": 1}}), "its y is 'None'"),
        (pose(pose={"position": {"x": 1, "y": True}}), "its y is 'True'"),
        (pose(pose={"position": {"x": 1, "y": "2"}}), "its y is '2'"),
        (pose(pose={"position": {"x": 1, "y": 10**400}}), "finite"),
        (pose(pose={"position": {"x": float("nan"), "y": 0}}), "finite"),
        (pose(pose={"position": {"x": 1, "y": 2}, "orientation": 4}), "orientation"),
    ],
)
def test_what_is_none_is_one_line(message: Any, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint) as error:
        parsed(message)
    assert "\n" not in str(error.value)


@UNHURRIED
@given(
    st.binary(max_size=200)
    | st.recursive(
        st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(
                st.sampled_from(["header", "pose", "position", "x", "y", "orientation"]), inner
            )
        ),
        max_leaves=12,
    ).map(lambda value: json.dumps(value).encode())
)
def test_whatever_comes_ends_in_a_pose_or_a_line(data: bytes) -> None:
    with contextlib.suppress(ValueError):
        assert isinstance(parse_pose(data).frame, str)


@pytest.mark.parametrize(("host", "is_open"), [("127.0.0.1", False), ("0.0.0.0", True)])
def test_only_loopback_is_closed(host: str, is_open: bool) -> None:
    assert FoxgloveSettings(host=host).is_open is is_open
