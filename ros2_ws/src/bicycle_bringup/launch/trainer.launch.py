"""The trainer, beside a bicycle that rides or on bags.

    ros2 launch bicycle_bringup trainer.launch.py mode:=live out:=runs/trainer-1

To ride beside it: `ros2 launch bicycle_bringup ride.launch.py`. `ros2_ws/trainer.sh` does the same
without launch.
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription

ARGUMENTS = {
    "namespace": ("", "of the bicycle, such as b1"),
    "mode": ("live", "live learns beside a ride, bags from recorded ones"),
    "bags": ("", "of mode bags: folder or bag"),
    "out": ("runs/trainer", "folder of the run"),
    "resume": ("false", "go on in that folder"),
}
"""Default and meaning of each argument."""


def generate_launch_description() -> LaunchDescription:
    """Describe the process."""
    given = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    words = {name: ParameterValue(given[name], value_type=str) for name in ("mode", "bags", "out")}
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=value, description=text)
                for name, (value, text) in ARGUMENTS.items()
            ),
            Node(
                package="bicycle_controller",
                executable="bicycle_trainer",
                namespace=given["namespace"],
                parameters=[{**words, "resume": ParameterValue(given["resume"], value_type=bool)}],
                output="screen",
            ),
        ]
    )
