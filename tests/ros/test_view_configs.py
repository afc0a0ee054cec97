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
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from bicycle_common.node_commands import config_folder
from bicycle_common.nodes import topics
from bicycle_common.nodes.topics import ODOM_FRAME, TOPICS, Topic
from bicycle_common.types import InitialPose
from bicycle_controller.nodes.hand_over_marks import WHERE, WHO, HandOverMarks
from bicycle_sim.nodes import visualization
from bicycle_sim.plants import registry
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named
from bicycle_tools.nodes.filling import filled

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
    "RobotModel": String,
    "SetGoal": PoseStamped,
    "SetInitialPose": PoseWithCovarianceStamped,
}
RVIZ_CLASSES = {
    *("Grid", "Marker", "MarkerArray", "Odometry", "Path", "Pose", "RobotModel", "TF"),
    *("MoveCamera", "Measure", "SetInitialPose", "SetGoal", "Orbit"),
}
URDF_FRAMES = ("base_footprint", "base_link")
UNUSED = ("/clicked_point",)
"""Foxglove's panel has a place for it; this stack does not hear it."""
MATHS = ("@rad2deg",)
"""Functions of Foxglove's message paths that the layout uses."""
CALLED = (topics.RESET, topics.PUSH)
SERVICES = {f"/{one.name}": one for one in CALLED}


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


PATHS = sorted(
    {text for text in texts(LAYOUT) if text.startswith("/")} - set(UNUSED) - set(SERVICES)
)


@pytest.mark.parametrize("path", PATHS)
def test_foxgloves_layout_names_topics_and_fields_that_exist(path: str) -> None:
    topic, *fields = path.split(".")
    message = TOPIC[topic].type()
    for field in fields:
        if field in MATHS:
            assert field == fields[-1]
            assert isinstance(message, float)
            continue
        assert field in message.get_fields_and_field_types()
        message = getattr(message, field)


def test_foxgloves_layout_shows_state_markers_command_and_goal() -> None:
    shown = {path.split(".")[0] for path in PATHS}
    wanted = (
        *(topics.STATE, topics.COMMAND, topics.MARKERS, topics.ACTIVE_GOAL),
        *(topics.GOAL_MARKER, topics.COMMAND_ECHO),
        *(topics.GOAL_STATUS, topics.TIMING, topics.DIAGNOSTICS),
        *(topics.HAND_OVER, topics.ROBOT_DESCRIPTION, topics.FOLLOWED_PATH),
    )
    assert {f"/{topic.name.lstrip('/')}" for topic in wanted} <= shown


def test_foxgloves_layout_sends_goals_that_the_stack_takes() -> None:
    panels = LAYOUT["configById"]
    publish = panels["3D!bicycle"]["publish"]
    assert publish["poseTopic"] == f"/{topics.GOAL_POSE.name}"
    assert publish["poseEstimateTopic"] == f"/{topics.INITIAL_POSE.name}"
    assert panels["3D!bicycle"]["followTf"] in URDF_FRAMES
    assert panels["3D!bicycle"]["fixedFrame"] == ODOM_FRAME
    button = panels["Publish!goal"]
    assert button["datatype"] == "geometry_msgs/msg/PoseStamped"
    assert TOPIC[button["topicName"]].type is PoseStamped
    assert json.loads(button["value"])["header"]["frame_id"] in topics.GOAL_FRAMES


def test_foxgloves_layout_calls_services_that_are_offered() -> None:
    calls = [v for k, v in LAYOUT["configById"].items() if k.startswith("CallService!")]
    assert {one["serviceName"] for one in calls} == {"/bicycle/reset", "/bicycle/push"}
    for one in calls:
        filled(SERVICES[one["serviceName"]].type.Request, one["requestPayload"])


PANELS = {
    "3D": "ThreeDeeConfig",
    "Plot": "PlotConfig",
    "RawMessages": "RawMessagesConfig",
    "StateTransitions": "StateTransitionsConfig",
    "DiagnosticSummary": "DiagnosticsSummaryConfig",
    "Publish": "PublishConfig",
    "CallService": "ServiceCallConfig",
}
"""Panels by their name in a layout file, and the SDK's definition of their settings."""
TITLE = {"title"}
"""Fields of a panel's frame, as opposed to its settings."""
OF_TOPIC = {
    "/robot_description": "BaseRendererUrdfTopicSettings",
    "/bicycle/markers": "BaseRendererRosMarkerTopicSettings",
    "/bicycle/goal_marker": "BaseRendererRosMarkerTopicSettings",
    "/bicycle/hand_over_markers": "BaseRendererRosMarkerTopicSettings",
    "/bicycle/active_goal": "BaseRendererPoseTopicSettings",
    "/goal_path": "BaseRendererPosesTopicSettings",
    "/bicycle/path": "BaseRendererPosesTopicSettings",
}


@pytest.mark.parametrize("panel", LAYOUT["configById"])
def test_foxgloves_sdk_defines_every_setting_of_the_layout(panel: str) -> None:
    """`foxglove.layouts` is generated from the app's own types."""
    layouts = pytest.importorskip("foxglove.layouts")

    def keys(name: str) -> set[str]:
        return set(getattr(layouts, name)()._to_dict())

    config = LAYOUT["configById"][panel]
    assert set(config) - TITLE <= keys(PANELS[panel.partition("!")[0]])
    series = {"Plot": "PlotSeries", "StateTransitions": "StateTransitionsSeries"}
    for path in config.get("paths", ()):
        assert set(path) <= keys(series[panel.partition("!")[0]])
    if panel.startswith("3D"):
        assert set(config["cameraState"]) <= keys("ThreeDeeCameraState")
        assert set(config["publish"]) <= keys("ThreeDeePublishSettings")
        assert set(config["scene"]) <= keys("BaseRendererSceneSettings")
        assert set(config["scene"]["transforms"]) <= keys("BaseRendererTransforms")
        for layer in config["layers"].values():
            assert set(layer) <= keys("BaseRendererGridLayerSettings")
        assert set(config["topics"]) == set(OF_TOPIC)
        for topic, settings in config["topics"].items():
            assert set(settings) <= keys(OF_TOPIC[topic])


def test_foxgloves_layout_places_every_panel_once() -> None:
    def leaves(node: Any) -> Iterator[str]:
        if isinstance(node, str):
            yield node
        else:
            yield from leaves(node["first"])
            yield from leaves(node["second"])

    assert sorted(leaves(LAYOUT["layout"])) == sorted(LAYOUT["configById"])


def topic_of(item: dict[str, Any]) -> Any:
    return item.get("Topic", item.get("Description Topic"))


def with_topics() -> list[Any]:
    return [item for item in [*RVIZ["Displays"], *RVIZ["Tools"]] if topic_of(item)]


@pytest.mark.parametrize("item", with_topics(), ids=lambda item: item["Class"].split("/")[1])
def test_rviz_shows_and_sends_what_the_topics_carry(item: dict[str, Any]) -> None:
    topic = TOPIC[topic_of(item)["Value"]]
    assert topic.type is IN_RVIZ[item["Class"].split("/")[1]]
    latched = topic.publish.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert topic_of(item)["Durability Policy"] == ("Transient Local" if latched else "Volatile")


def published_namespaces() -> dict[str, set[str]]:
    """Return the namespaces of the marker arrays that the nodes make, by topic."""
    snapshot = Simulator(named("random-start-random-goal")).reset(InitialPose(0.0, 0.0, 0.0, 2.8))
    arrays = {
        topics.MARKERS.name: visualization.markers(snapshot, 0, registry.default().geometry),
        topics.HAND_OVER_MARKERS.name: HandOverMarks().clear(),
    }
    return {f"/{name}": {one.ns for one in array.markers} for name, array in arrays.items()}


def test_rviz_switches_every_namespace_of_markers_and_no_other() -> None:
    """One that the file does not name would be shown, and hide the model under a drawing."""
    arrays = [one for one in RVIZ["Displays"] if one["Class"].endswith("/MarkerArray")]
    found = {one["Topic"]["Value"]: set(one["Namespaces"]) for one in arrays}
    assert found == published_namespaces()
    shown = {name for one in arrays for name, on in one["Namespaces"].items() if on}
    assert shown == {"numbers", WHO, WHERE}
    assert all(one["Enabled"] for one in arrays)


def test_rviz_has_the_goal_and_the_frame() -> None:
    kinds = {item["Class"].split("/")[1] for item in with_topics()}
    assert kinds == set(IN_RVIZ)
    assert RVIZ["Global Options"]["Fixed Frame"] == ODOM_FRAME
    assert RVIZ["Views"]["Current"]["Target Frame"] in URDF_FRAMES


def test_rviz_has_a_class_for_each() -> None:
    """Names of `rviz_default_plugins/plugins_description.xml` of Jazzy."""
    used = {item["Class"] for item in [*RVIZ["Displays"], *RVIZ["Tools"]]}
    used.add(RVIZ["Views"]["Current"]["Class"])
    assert {one.partition("/")[0] for one in used} == {"rviz_default_plugins"}
    assert {one.partition("/")[2] for one in used} <= RVIZ_CLASSES
