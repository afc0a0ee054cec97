"""Several bicycles in one domain, each in a namespace of its own, that keep clear of one another.

    ros2 launch bicycle_bringup fleet.launch.py bicycles:=3 plant:=whipple bicycle:=browser-rider

They wait for orders: `goal.sh 30 0 __ns:=/b1`, `path.sh FILE --namespace /b2` or the actions of
their names. `ros2_ws/fleet.sh` starts such a fleet without launch and gives each a route, too.
"""

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.launch_context import LaunchContext
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

ARGUMENTS = {
    "bicycles": ("10", "how many; they are called b1, b2 and so on"),
    "spacing": ("18.0", "m between their starts, side by side"),
    "scenario": ("learned-speed", "limits, start speed and goal radius"),
    "plant": ("choi", "choi, whipple or mujoco"),
    "bicycle": ("", "of whipple or mujoco; empty is the benchmark"),
    "policy": ("lqr-pedal", "what rides: a policy's file or name, or an LQR"),
}
"""Default and meaning of each argument."""


def nodes(context: LaunchContext) -> list[Node]:
    """Return simulator and controller of each bicycle."""
    count = int(LaunchConfiguration("bicycles").perform(context))
    spacing = float(LaunchConfiguration("spacing").perform(context))
    config = PathJoinSubstitution([FindPackageShare("bicycle_bringup"), "config"])
    words = {
        name: ParameterValue(LaunchConfiguration(name), value_type=str)
        for name in ("scenario", "plant", "bicycle", "policy")
    }
    policy = words.pop("policy")
    names = [f"b{number + 1}" for number in range(count)]
    found = []
    for number, name in enumerate(names):
        simulated = {**words, "start_y": spacing * number, "publish_clock": number == 0}
        others = ",".join(other for other in names if other != name)
        found += [
            Node(
                package="bicycle_sim",
                executable="bicycle_sim",
                namespace=name,
                parameters=[PathJoinSubstitution([config, "simulator.yaml"]), simulated],
                output="screen",
            ),
            Node(
                package="bicycle_controller",
                executable="bicycle_controller",
                namespace=name,
                parameters=[
                    PathJoinSubstitution([config, "controller.yaml"]),
                    {"policy": policy, "keep_clear": others},
                ],
                output="screen",
                respawn=True,
                respawn_delay=1.0,
            ),
        ]
    return found


def generate_launch_description() -> LaunchDescription:
    """Describe the processes."""
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=value, description=text)
                for name, (value, text) in ARGUMENTS.items()
            ),
            OpaqueFunction(function=nodes),
        ]
    )
