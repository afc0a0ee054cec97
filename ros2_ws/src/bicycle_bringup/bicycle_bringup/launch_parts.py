"""Arguments, nodes and the recorder that the launch files share; only for ROS 2's launch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition
from launch.launch_context import LaunchContext
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

Arguments = dict[str, tuple[str, str]]
"""Default and meaning of each argument of a launch file."""

SHARED: Arguments = {
    "namespace": ("", "of the bicycle, such as b1"),
    "record": ("true", "record a bag of all topics"),
    "scenario": ("learned-speed", "limits, start speed and goal radius"),
    "plant": ("choi", "choi, whipple or mujoco"),
    "bicycle": ("", "of whipple or mujoco; empty is the benchmark"),
    "policy": ("lqr-pedal", "what rides: a policy's file or name, or an LQR"),
}
"""Arguments of several launch files."""

RESPAWN = {"respawn": True, "respawn_delay": 1.0}
"""Options of a node that is started again when it ends."""


def shared(*names: str, **defaults: str) -> Arguments:
    """Return arguments of `SHARED`: `names` with their defaults, and others with new ones."""
    chosen = {name: SHARED[name] for name in names}
    return chosen | {name: (value, SHARED[name][1]) for name, value in defaults.items()}


def declared(arguments: Arguments) -> list[DeclareLaunchArgument]:
    """Return the actions that declare the arguments."""
    return [
        DeclareLaunchArgument(name, default_value=value, description=text)
        for name, (value, text) in arguments.items()
    ]


def words(*names: str) -> dict[str, ParameterValue]:
    """Return parameters of the arguments' names; a word that looks like a number stays one."""
    return {name: ParameterValue(LaunchConfiguration(name), value_type=str) for name in names}


def given_words(context: LaunchContext, *names: str) -> dict[str, ParameterValue]:
    """Return `words` of the arguments that are not empty: the others stay as in the YAML file."""
    return words(*(name for name in names if LaunchConfiguration(name).perform(context)))


def config(name: str) -> PathJoinSubstitution:
    """Return the path of a file of `config`."""
    return PathJoinSubstitution([FindPackageShare("bicycle_bringup"), "config", name])


def recorder() -> ExecuteProcess:
    """Return the recorder of all topics; it runs if the argument `record` is true."""
    return ExecuteProcess(
        cmd=["ros2", "bag", "record", "--all"],
        condition=IfCondition(LaunchConfiguration("record")),
        sigterm_timeout="10",
    )


def simulator(namespace: Any, parameters: Mapping[str, Any]) -> Node:
    """Return the simulator with its YAML file and `parameters`, which win over it."""
    return Node(
        package="bicycle_sim",
        executable="bicycle_sim",
        namespace=namespace,
        parameters=[config("simulator.yaml"), dict(parameters)],
        output="screen",
    )


def controller(namespace: Any, parameters: Mapping[str, Any], **options: Any) -> Node:
    """Return the controller with its YAML file and `parameters`, which win over it.

    Args:
        namespace: of the bicycle.
        parameters: by name.
        options: of the node, such as `RESPAWN`.
    """
    return Node(
        package="bicycle_controller",
        executable="bicycle_controller",
        namespace=namespace,
        parameters=[config("controller.yaml"), dict(parameters)],
        output="screen",
        **options,
    )
