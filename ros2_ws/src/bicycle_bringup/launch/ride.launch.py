"""Simulator, controller and recorder with a native ROS 2.

    ros2 launch bicycle_bringup ride.launch.py

The PyPI wheels have no launch, so `ros2_ws/ride.sh` replaces this file there, and it could not
be run where the project is developed; it follows Jazzy's documentation.
"""

from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Describe the three processes."""
    config = PathJoinSubstitution([FindPackageShare("bicycle_bringup"), "config"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value="", description="of the bicycle"),
            DeclareLaunchArgument("record", default_value="true", description="record a bag"),
            ExecuteProcess(
                cmd=["ros2", "bag", "record", "--all"],
                condition=IfCondition(LaunchConfiguration("record")),
                sigterm_timeout="10",
            ),
            Node(
                package="bicycle_sim",
                executable="bicycle_sim",
                namespace=LaunchConfiguration("namespace"),
                parameters=[PathJoinSubstitution([config, "simulator.yaml"])],
                output="screen",
            ),
            Node(
                package="bicycle_controller",
                executable="bicycle_controller",
                namespace=LaunchConfiguration("namespace"),
                parameters=[PathJoinSubstitution([config, "controller.yaml"])],
                output="screen",
                respawn=True,
                respawn_delay=1.0,
            ),
        ]
    )
