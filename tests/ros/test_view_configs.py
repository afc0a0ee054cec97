"""The files for Foxglove and RViz, against the topics and messages that they name."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest
import yaml
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry, Path
from rclpy.qos import DurabilityPolicy
from visualization_msgs.msg import Marker, MarkerArray

from bicycle_common.node_commands import config_folder
from bicycle_common.nodes import topics
from bicycle_common.nodes.topics import ODOM_FRAME, TOPICS, Topic

pytestmark = pytest.mark.ros

TOPIC: dict[str, Topic] = {f"/{topic.name.lstrip('/')}": topic for topic in TOPICS}
LAYOUT = json.loads((config_folder() / "foxglove-layout.json").read_text())
RVIZ = yaml.safe_load((config_folder() / "bicycle.rviz").read_text())["Visualization Manager"]
IN_RVIZ = {
    "Marker": Marker,
    "MarkerArray": MarkerArray,
    "Odometry": Odometry,
    "Pose": PoseStamped,
    "Path": Path,
    "SetGoal": PoseStamped,
    "SetInitialPose": PoseWithCovarianceStamped,
}
UNUSED = ("/clicked_point",)
"""Foxglove's panel has a place for it; this stack does not hear it."""


def texts(value: Any) -> Iterator[str]:
    """Yield all strings in plain data, keys and values."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from texts(key)
            yield from texts(item)
    elif isinstance(value, list):
        for item in value:
            yield from texts(item)


PATHS = sorted({text for text in texts(LAYOUT) if text.startswith("/")} - set(UNUSED))


@pytest.mark.parametrize("path", PATHS)
def test_foxgloves_layout_names_topics_and_fields_that_exist(path: str) -> None:
    topic, *fields = path.split(".")
    message = TOPIC[topic].type()
    for field in fields:
        assert field in message.get_fields_and_field_types()
        message = getattr(message, field)


def test_foxgloves_layout_shows_state_markers_command_and_goal() -> None:
    shown = {path.split(".")[0] for path in PATHS}
    wanted = (
        *(topics.STATE, topics.COMMAND, topics.MARKERS, topics.ACTIVE_GOAL),
        *(topics.GOAL_MARKER, topics.COMMAND_ECHO),
        *(topics.GOAL_STATUS, topics.TIMING, topics.DIAGNOSTICS),
    )
    assert {f"/{topic.name.lstrip('/')}" for topic in wanted} <= shown


def test_foxgloves_layout_sends_goals_that_the_stack_takes() -> None:
    panels = LAYOUT["configById"]
    publish = panels["3D!bicycle"]["publish"]
    assert publish["poseTopic"] == f"/{topics.GOAL_POSE.name}"
    assert publish["poseEstimateTopic"] == f"/{topics.INITIAL_POSE.name}"
    assert panels["3D!bicycle"]["followTf"] == ODOM_FRAME
    button = panels["Publish!goal"]
    assert button["datatype"] == "geometry_msgs/msg/PoseStamped"
    assert TOPIC[button["topicName"]].type is PoseStamped
    assert json.loads(button["value"])["header"]["frame_id"] in topics.GOAL_FRAMES


def test_foxgloves_layout_places_every_panel_once() -> None:
    def leaves(node: Any) -> Iterator[str]:
        if isinstance(node, str):
            yield node
        else:
            yield from leaves(node["first"])
            yield from leaves(node["second"])

    assert sorted(leaves(LAYOUT["layout"])) == sorted(LAYOUT["configById"])


def with_topics() -> list[Any]:
    return [item for item in [*RVIZ["Displays"], *RVIZ["Tools"]] if "Topic" in item]


@pytest.mark.parametrize("item", with_topics(), ids=lambda item: item["Class"].split("/")[1])
def test_rviz_shows_and_sends_what_the_topics_carry(item: dict[str, Any]) -> None:
    topic = TOPIC[item["Topic"]["Value"]]
    assert topic.type is IN_RVIZ[item["Class"].split("/")[1]]
    latched = topic.publish.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert item["Topic"]["Durability Policy"] == ("Transient Local" if latched else "Volatile")


def test_rviz_has_the_goal_and_the_frame() -> None:
    kinds = {item["Class"].split("/")[1] for item in with_topics()}
    assert kinds == set(IN_RVIZ)
    assert RVIZ["Global Options"]["Fixed Frame"] == ODOM_FRAME
