"""Simulator, controller and the page in the browser.

    ros2 launch bicycle_bringup cockpit.launch.py port:=8765

With `ride:=false` it shows what runs already. `ros2_ws/cockpit.sh` does the same without launch.
"""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

ARGUMENTS = {
    "ride": ("true", "start simulator and controller, too"),
    "port": ("8765", "of the page; 0 takes a free one"),
    "bags": ("runs", "folder of bags to look at, and of new ones"),
    "namespace": ("", "of the bicycle, such as b1"),
    "scenario": ("random-start-random-goal", "limits, start speed and goal radius"),
    "plant": ("choi", "choi, whipple or mujoco"),
    "bicycle": ("", "of whipple or mujoco; empty is the benchmark"),
    "policy": ("fixed-speed", "what rides: a policy's file or name, or an LQR"),
}
"""Default and meaning of each argument."""
PASSED = ("namespace", "scenario", "plant", "bicycle", "policy")
"""Arguments of ride.launch.py."""


def generate_launch_description() -> LaunchDescription:
    """Describe the processes."""
    launch = PathJoinSubstitution([FindPackageShare("bicycle_bringup"), "launch"])
    given = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    passed = {name: given[name] for name in PASSED} | {"record": "false"}
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=value, description=text)
                for name, (value, text) in ARGUMENTS.items()
            ),
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
