"""Several bicycles in one domain, each in a namespace of its own, that keep clear of one another.

    ros2 launch bicycle_bringup fleet.launch.py bicycles:=3 plant:=whipple bicycle:=browser-rider

They wait for orders: `goal.sh 30 0 __ns:=/b1`, `path.sh FILE --namespace /b2` or the actions of
their names. `ros2_ws/fleet.sh` starts such a fleet without launch and gives each a route, too.
"""

from launch.actions import OpaqueFunction
from launch.launch_context import LaunchContext
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from bicycle_bringup.launch_parts import RESPAWN, controller, declared, shared, simulator, words
from launch import LaunchDescription

ARGUMENTS = {
    "bicycles": ("10", "how many; they are called b1, b2 and so on"),
    "spacing": ("18.0", "m between their starts, side by side"),
} | shared("scenario", "plant", "bicycle", "policy")
"""Default and meaning of each argument."""


def nodes(context: LaunchContext) -> list[Node]:
    """Return simulator and controller of each bicycle."""
    count = int(LaunchConfiguration("bicycles").perform(context))
    spacing = float(LaunchConfiguration("spacing").perform(context))
    names = [f"b{number + 1}" for number in range(count)]
    found = []
    for number, name in enumerate(names):
        start = {"start_y": spacing * number, "publish_clock": number == 0}
        others = ",".join(other for other in names if other != name)
        found += [
            simulator(name, words("scenario", "plant", "bicycle") | start),
            controller(name, words("policy") | {"keep_clear": others}, **RESPAWN),
        ]
    return found


def generate_launch_description() -> LaunchDescription:
    """Describe the processes."""
    return LaunchDescription([*declared(ARGUMENTS), OpaqueFunction(function=nodes)])
