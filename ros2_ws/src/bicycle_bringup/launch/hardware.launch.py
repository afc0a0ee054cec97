"""Driver, controller on estimates and recorder of a real bicycle, with a native ROS 2.

    ros2 launch bicycle_bringup hardware.launch.py port:=/dev/ttyACM0

The PyPI wheels have no launch; there `driver.sh` and `controller.sh` start the same, as
docs/real-bicycle.md says. This file could not be run where the project is developed; it follows
Jazzy's documentation. Nothing moves before bicycle/arm.
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
    sensors = {"sensors": LaunchConfiguration("sensors")}
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value="", description="of the bicycle"),
            DeclareLaunchArgument("record", default_value="true", description="record a bag"),
            DeclareLaunchArgument(
                "port", default_value="/dev/ttyACM0", description="the microcontroller's line"
            ),
            DeclareLaunchArgument("bicycle", default_value="", description="a name or YAML file"),
            DeclareLaunchArgument("sensors", default_value="mpu6050", description="the same"),
            DeclareLaunchArgument("policy", default_value="lqr", description="what rides"),
            ExecuteProcess(
                cmd=["ros2", "bag", "record", "--all"],
                condition=IfCondition(LaunchConfiguration("record")),
                sigterm_timeout="10",
            ),
            Node(
                package="bicycle_hardware",
                executable="bicycle_driver",
                namespace=LaunchConfiguration("namespace"),
                parameters=[
                    PathJoinSubstitution([config, "driver.yaml"]),
                    sensors,
                    {"port": LaunchConfiguration("port")},
                    {"bicycle": LaunchConfiguration("bicycle")},
                ],
                output="screen",
                respawn=True,
                respawn_delay=1.0,
            ),
            Node(
                package="bicycle_controller",
                executable="bicycle_controller",
                namespace=LaunchConfiguration("namespace"),
                parameters=[
                    PathJoinSubstitution([config, "controller.yaml"]),
                    sensors,
                    {"state": "estimated", "policy": LaunchConfiguration("policy")},
                ],
                remappings=[("bicycle/estimate", "bicycle/state")],
                output="screen",
            ),
        ]
    )
