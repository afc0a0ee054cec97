"""Simulator, controller and a recorder.

    ros2 launch bicycle_bringup ride.launch.py plant:=whipple bicycle:=browser-rider course:=slalom

`ros2 launch bicycle_bringup ride.launch.py --show-args` lists the arguments. Where there is no
launch, as with ROS 2 from PyPI, `ros2_ws/ride.sh` does the same.
"""

from launch.actions import OpaqueFunction
from launch.conditions import IfCondition
from launch.launch_context import LaunchContext
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.actions import Node

from bicycle_bringup.launch_parts import (
    RESPAWN,
    SHARED,
    controller,
    declared,
    given_words,
    recorder,
    shared,
    simulator,
    words,
)
from launch import LaunchDescription

ARGUMENTS = shared(*SHARED) | {
    "pace": ("realtime", "realtime or lockstep"),
    "course": ("", "a course to follow, by name or file; empty waits for goals"),
    "state": ("", "truth or estimated; empty as in controller.yaml"),
    "sensors": ("", "of simulator and estimator: a preset or YAML file; empty as in theirs"),
    "keep_clear": ("", "namespaces of other bicycles, as b2,b3; empty as in controller.yaml"),
    "after_goal": ("", "hold, circle or slow; empty as in controller.yaml"),
}
"""Default and meaning of each argument."""


def nodes(context: LaunchContext) -> list[Node]:
    """Return simulator and controller."""
    namespace = LaunchConfiguration("namespace")
    simulated = words("scenario", "plant", "bicycle", "pace") | given_words(context, "sensors")
    asked = given_words(context, "state", "sensors", "keep_clear", "after_goal")
    return [
        simulator(namespace, simulated),
        controller(namespace, words("policy") | asked, **RESPAWN),
    ]


def generate_launch_description() -> LaunchDescription:
    """Describe the processes."""
    course, namespace = LaunchConfiguration("course"), LaunchConfiguration("namespace")
    return LaunchDescription(
        [
            *declared(ARGUMENTS),
            recorder(),
            OpaqueFunction(function=nodes),
            Node(
                package="bicycle_tools",
                executable="bicycle_path",
                arguments=[course, "--namespace", ["/", namespace]],
                condition=IfCondition(PythonExpression(["'", course, "' != ''"])),
                output="screen",
            ),
        ]
    )
