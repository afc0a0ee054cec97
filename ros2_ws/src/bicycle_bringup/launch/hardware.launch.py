"""The driver of a real bicycle's microcontroller, and the controller that rides it by estimates.

    ros2 launch bicycle_bringup hardware.launch.py port:=/dev/ttyACM0 bicycle:=my-bicycle.yaml

It arms nothing: the service `bicycle/arm` does, see docs/real-bicycle.md. `ros2_ws/driver.sh` and
`controller.sh state:=estimated` do the same without launch.
"""

from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from bicycle_common.topic_names import ESTIMATE, STATE
from launch import LaunchDescription

ARGUMENTS = {
    "namespace": ("", "of the bicycle, such as b1"),
    "port": ("/dev/ttyACM0", "serial line of the microcontroller"),
    "bicycle": ("", "parameters: a name, or a YAML file; empty is the benchmark"),
    "sensors": ("mpu6050", "what the sensors are like: a preset, or a YAML file"),
    "policy": ("lqr", "what rides: a policy's file or name, or an LQR"),
    "record": ("true", "record a bag of all topics"),
}
"""Default and meaning of each argument."""


def generate_launch_description() -> LaunchDescription:
    """Describe the processes."""
    config = PathJoinSubstitution([FindPackageShare("bicycle_bringup"), "config"])
    given = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    words = {name: ParameterValue(value, value_type=str) for name, value in given.items()}
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=value, description=text)
                for name, (value, text) in ARGUMENTS.items()
            ),
            ExecuteProcess(
                cmd=["ros2", "bag", "record", "--all"],
                condition=IfCondition(given["record"]),
                sigterm_timeout="10",
            ),
            Node(
                package="bicycle_hardware",
                executable="bicycle_driver",
                namespace=given["namespace"],
                parameters=[
                    PathJoinSubstitution([config, "driver.yaml"]),
                    {name: words[name] for name in ("port", "bicycle", "sensors")},
                ],
                output="screen",
            ),
            Node(
                package="bicycle_controller",
                executable="bicycle_controller",
                namespace=given["namespace"],
                parameters=[
                    PathJoinSubstitution([config, "controller.yaml"]),
                    {"state": "estimated", "sensors": words["sensors"], "policy": words["policy"]},
                ],
                # Nothing else says where the bicycle is.
                remappings=[(ESTIMATE, STATE)],
                output="screen",
            ),
        ]
    )
