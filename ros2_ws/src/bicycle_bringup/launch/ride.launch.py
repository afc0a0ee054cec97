"""Simulator, controller and a recorder.

    ros2 launch bicycle_bringup ride.launch.py plant:=whipple bicycle:=browser-rider course:=slalom

`ros2 launch bicycle_bringup ride.launch.py --show-args` lists the arguments. Where there is no
launch, as with ROS 2 from PyPI, `ros2_ws/ride.sh` does the same.
"""

from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

ARGUMENTS = {
    "namespace": ("", "of the bicycle, such as b1"),
    "record": ("true", "record a bag of all topics"),
    "scenario": ("learned-speed", "limits, start speed and goal radius"),
    "plant": ("choi", "choi, whipple or mujoco"),
    "bicycle": ("", "of whipple or mujoco; empty is the benchmark"),
    "pace": ("realtime", "realtime or lockstep"),
    "policy": ("lqr-pedal", "what rides: a policy's file or name, or an LQR"),
    "course": ("", "a course to follow, by name or file; empty waits for goals"),
}
"""Default and meaning of each argument."""


def generate_launch_description() -> LaunchDescription:
    """Describe the processes."""
    config = PathJoinSubstitution([FindPackageShare("bicycle_bringup"), "config"])
    given = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    words = {name: ParameterValue(value, value_type=str) for name, value in given.items()}
    simulated = {name: words[name] for name in ("scenario", "plant", "bicycle", "pace")}
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
                package="bicycle_sim",
                executable="bicycle_sim",
                namespace=given["namespace"],
                parameters=[PathJoinSubstitution([config, "simulator.yaml"]), simulated],
                output="screen",
            ),
            Node(
                package="bicycle_controller",
                executable="bicycle_controller",
                namespace=given["namespace"],
                parameters=[
                    PathJoinSubstitution([config, "controller.yaml"]),
                    {"policy": words["policy"]},
                ],
                output="screen",
                respawn=True,
                respawn_delay=1.0,
            ),
            Node(
                package="bicycle_tools",
                executable="bicycle_path",
                arguments=[given["course"], "--namespace", ["/", given["namespace"]]],
                condition=IfCondition(PythonExpression(["'", given["course"], "' != ''"])),
                output="screen",
            ),
        ]
    )
