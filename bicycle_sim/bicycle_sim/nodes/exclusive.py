"""Detection of a second simulator of the same bicycle."""

from __future__ import annotations

import os
import time

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from bicycle_common.nodes.runner import UserError
from bicycle_common.nodes.topics import STATE

DISCOVERY = 0.5
"""Time that nodes of one machine need to discover each other, with a margin (s)."""
PROOF = 1.0
"""Time for which to listen for a running simulator (s); a killed one stays listed for seconds."""


UNKNOWN = "_NODE_NAME_UNKNOWN_"
"""Name that ROS gives to a node that is not known yet."""


def _publishers(node: Node) -> set[str]:
    """Return the names of the nodes that publish states."""
    return {info.node_name for info in node.get_publishers_info_by_topic(STATE.name)}


def refuse_second_simulator(node: Node) -> None:
    """Refuse to start if another simulator publishes states on this domain and namespace.

    Raises:
        UserError: if one does.
    """
    heard: list[bytes] = []
    subscription = node.create_subscription(
        STATE.type, STATE.name, heard.append, STATE.subscribe, raw=True
    )
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    deadline = time.monotonic() + DISCOVERY
    suspected = False
    while not heard and time.monotonic() < deadline:
        if not suspected and node.count_publishers(STATE.name) > 0:
            suspected = True
            deadline = time.monotonic() + PROOF
        executor.spin_once(timeout_sec=0.02)
    others = _publishers(node)
    deadline = time.monotonic() + PROOF
    while heard and UNKNOWN in others and time.monotonic() < deadline:
        executor.spin_once(timeout_sec=0.02)  # a node's name comes after its topics
        others = _publishers(node)
    executor.remove_node(node)
    executor.shutdown()
    if heard:
        raise UserError(
            f"another simulator ({', '.join(sorted(others)) or 'unknown'}) publishes "
            f"{node.resolve_topic_name(STATE.name)} on ROS_DOMAIN_ID="
            f"{os.environ.get('ROS_DOMAIN_ID', '0')}: stop it with ros2_ws/stop.sh, or start this "
            "one with another ROS_DOMAIN_ID or namespace"
        )
    node.destroy_subscription(subscription)
