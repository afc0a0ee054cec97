"""Simulator, controller and the page in the browser.

    ros2 launch bicycle_bringup cockpit.launch.py port:=8765

With `ride:=false` it shows what runs already. `ros2_ws/cockpit.sh` does the same without launch.
"""

from launch.actions import IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from bicycle_bringup.launch_parts import declared, shared
from launch import LaunchDescription

PASSED = shared(
    "namespace", "plant", "bicycle", scenario="random-start-random-goal", policy="fixed-speed"
)
"""Default and meaning of the arguments of ride.launch.py."""

ARGUMENTS = {
    "ride": ("true", "start simulator and controller, too"),
    "port": ("8765", "of the page; 0 takes a free one"),
    "bags": ("runs", "folder of bags to look at, and of new ones"),
} | PASSED
"""Default and meaning of each argument."""


def generate_launch_description() -> LaunchDescription:
    """Describe the processes."""
    launch = PathJoinSubstitution([FindPackageShare("bicycle_bringup"), "launch"])
    given = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    passed = {name: given[name] for name in PASSED} | {"record": "false"}
    return LaunchDescription(
        [
            *declared(ARGUMENTS),
            IncludeLaunchDescription(
                PathJoinSubstitution([launch, "ride.launch.py"]),
                launch_arguments=passed.items(),
                condition=IfCondition(given["ride"]),
            ),
            Node(
                package="bicycle_cockpit",
                executable="bicycle_cockpit",
                namespace=given["namespace"],
                arguments=["--no-ride", "--port", given["port"], "--bags", given["bags"]],
                output="screen",
            ),
        ]
    )
