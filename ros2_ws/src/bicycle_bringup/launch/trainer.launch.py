"""The trainer, beside a bicycle that rides or on bags.

    ros2 launch bicycle_bringup trainer.launch.py mode:=live out:=runs/trainer-1

To ride beside it: `ros2 launch bicycle_bringup ride.launch.py`. `ros2_ws/trainer.sh` does the same
without launch.
"""

from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from bicycle_bringup.launch_parts import declared, shared, words
from launch import LaunchDescription

ARGUMENTS = shared("namespace") | {
    "mode": ("live", "live learns beside a ride, bags from recorded ones"),
    "bags": ("", "of mode bags: folder or bag"),
    "out": ("runs/trainer", "folder of the run"),
    "resume": ("false", "go on in that folder"),
}
"""Default and meaning of each argument."""


def generate_launch_description() -> LaunchDescription:
    """Describe the process."""
    resume = ParameterValue(LaunchConfiguration("resume"), value_type=bool)
    return LaunchDescription(
        [
            *declared(ARGUMENTS),
            Node(
                package="bicycle_controller",
                executable="bicycle_trainer",
                namespace=LaunchConfiguration("namespace"),
                parameters=[words("mode", "bags", "out") | {"resume": resume}],
                output="screen",
            ),
        ]
    )
