"""The driver of a real bicycle's microcontroller, and the controller that rides it by estimates.

    ros2 launch bicycle_bringup hardware.launch.py port:=/dev/ttyACM0 bicycle:=my-bicycle.yaml

It arms nothing: the service `bicycle/arm` does, see docs/real-bicycle.md. `ros2_ws/driver.sh` and
`controller.sh state:=estimated` do the same without launch.
"""

from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from bicycle_bringup.launch_parts import config, controller, declared, recorder, shared, words
from bicycle_common.topic_names import ESTIMATE, STATE
from launch import LaunchDescription

ARGUMENTS = {
    "port": ("/dev/ttyACM0", "serial line of the microcontroller"),
    "bicycle": ("", "parameters: a name, or a YAML file; empty is the benchmark"),
    "sensors": ("mpu6050", "what the sensors are like: a preset, or a YAML file"),
} | shared("namespace", "record", policy="lqr")
"""Default and meaning of each argument."""


def generate_launch_description() -> LaunchDescription:
    """Describe the processes."""
    namespace = LaunchConfiguration("namespace")
    return LaunchDescription(
        [
            *declared(ARGUMENTS),
            recorder(),
            Node(
                package="bicycle_hardware",
                executable="bicycle_driver",
                namespace=namespace,
                parameters=[config("driver.yaml"), words("port", "bicycle", "sensors")],
                output="screen",
            ),
            controller(
                namespace,
                {"state": "estimated"} | words("sensors", "policy"),
                # Nothing else says where the bicycle is.
                remappings=[(ESTIMATE, STATE)],
            ),
        ]
    )
