"""Page of all topics, services, actions, their types and QoS, made from the code.

python -m bicycle_common.nodes.interfaces > docs/interfaces.md
"""

from __future__ import annotations

from typing import Any

from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from bicycle_common.nodes import topics

HEAD = (
    "# Topics, services, actions, frames\n"
    "\n"
    "This page is made from the code by `python -m bicycle_common.nodes.interfaces`, and "
    "a test holds it. Names are relative, so a namespace (`__ns:=/b1`) makes one bicycle "
    "of a fleet; those with a slash in front are absolute by convention.\n"
    "\n"
)

FRAMES = (
    "## Frames\n"
    "\n"
    "`map` → `odom` (latched, the identity of simulated truth) → `base_footprint` (the "
    "rear contact, heading only) → `base_link` (leans) → `steer_link` → "
    "`front_wheel_link`; `rear_wheel_link` and `crank_link` hang on `base_link`. A "
    "bicycle in the namespace `/b1` has `b1/odom`, `b1/base_link` and so on below `map`; "
    "its URDF on `robot_description` has these names, too, and meshes of the ridden "
    "bicycle's sizes in `package://bicycle_sim/meshes`. `odom` gives the pose of "
    "`base_link` at the rear contact and the twist in `base_link`, which leans; its "
    "covariances are 1e-9, since it is the simulator's truth. Goals and paths may come in "
    "`odom` or `map`, with or without the namespace before it.\n"
    "\n"
    "## Managed states and parameters\n"
    "\n"
    "The controller is a managed node (`ros2 lifecycle`, services "
    "`bicycle_controller/change_state` and so on). By default it configures and activates "
    "itself; with `managed:=true` it waits for both. While it is not active it answers no "
    "state, which the simulator takes as silence, and refuses orders. The simulator is not a "
    "managed node; `bicycle/pause` stops its time.\n"
    "\n"
    "`ros2 param set` changes the parameters that may change while a node runs. For the others "
    "it prints one line that says why not. `ros2 param describe` says which is which.\n"
    "\n"
    "## Not run here\n"
    "\n"
    "Native ROS 2, Nav2, RViz and the launch files could not be run where this project is"
    " developed; the names, types and QoS follow their documentation. With the PyPI "
    "wheels `tf2_msgs` is built in the workspace, under its own name; with a native ROS 2"
    " that package is left empty.\n"
)


def type_name(kind: Any, folder: str) -> str:
    """Return a type as `geometry_msgs/msg/Twist`."""
    return f"{kind.__module__.partition('.')[0]}/{folder}/{kind.__name__}"


def quality(profile: Any) -> str:
    """Return a profile in words."""
    words = ["reliable" if profile.reliability is ReliabilityPolicy.RELIABLE else "best effort"]
    if profile.durability is DurabilityPolicy.TRANSIENT_LOCAL:
        words.append("latched")
    words.append(f"depth {profile.depth}")
    deadline = profile.deadline.nanoseconds * 1e-9
    if 0.0 < deadline < 1e6:
        words.append(f"deadline {deadline:g} s offered")
    return ", ".join(words)


def page() -> str:
    """Return the page as Markdown."""
    lines = [HEAD, "## Topics\n\n", "| topic | type | published as | subscribed as |\n"]
    lines.append("| --- | --- | --- | --- |\n")
    for one in topics.TOPICS:
        cells = f"`{one.name}`", type_name(one.type, "msg"), quality(one.publish)
        lines.append(f"| {' | '.join(cells)} | {quality(one.subscribe)} |\n")
    found = [one for one in vars(topics).values() if isinstance(one, topics.Service)]
    lines += ["\n## Services\n\n", "| service | type |\n| --- | --- |\n"]
    lines += [f"| `{one.name}` | {type_name(one.type, 'srv')} |\n" for one in found]
    actions = [one for one in vars(topics).values() if isinstance(one, topics.Action)]
    lines += ["\n## Actions\n\n", "| action | type |\n| --- | --- |\n"]
    lines += [f"| `{one.name}` | {type_name(one.type, 'action')} |\n" for one in actions]
    for name in ("NavigateToPose", "NavigateThroughPoses", "FollowPath"):
        plain = "".join(f"_{c.lower()}" if c.isupper() else c for c in name).strip("_")
        lines.append(f"| `{plain}` | nav2_msgs/action/{name}, where installed |\n")
    return "".join([*lines, "\n", FRAMES])


if __name__ == "__main__":
    print(page(), end="")
