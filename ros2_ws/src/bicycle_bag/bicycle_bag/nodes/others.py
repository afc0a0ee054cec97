"""Other publishers of the topics that a replay is going to publish."""

from __future__ import annotations

from collections.abc import Iterable

from rclpy.node import Node

from bicycle_bag.selection import echo_of
from bicycle_common.topic_names import (
    CMD_VEL,
    COMMAND,
    DIAGNOSTICS,
    GOAL_PATH,
    GOAL_POSE,
    INITIAL_POSE,
    STATE,
    TF,
    TF_STATIC,
)

SHARED = ("/rosout", "/parameter_events", DIAGNOSTICS, TF, TF_STATIC)
"""Topics that many nodes publish by convention."""
INPUTS = (GOAL_POSE, GOAL_PATH, INITIAL_POSE, "clicked_point", "joy", CMD_VEL)
"""Last parts of the names of topics by which people and tools give orders: each tool that may
give them publishes them, so that a viewer beside a replay does."""


def guarded(topics: Iterable[str]) -> list[str]:
    """Return the topics that have one publisher by their nature."""
    return [
        name for name in topics if name not in SHARED and name.rpartition("/")[2] not in INPUTS
    ]


def drivers_of_states_alone(topics: Iterable[str]) -> list[str]:
    """Return the topics of commands beside states that are played without their echoes.

    The echoes tell a controller who drives. Without them it takes the bag's states for its own
    bicycle's.
    """
    names = set(topics)
    return [
        name.removesuffix(STATE) + COMMAND
        for name in sorted(names)
        if echo_of(name) and echo_of(name) not in names
    ]


def other_publishers(node: Node, topics: Iterable[str], own: int) -> dict[str, list[str]]:
    """Return the nodes that publish some topics, except `node` itself.

    Args:
        node: in the graph.
        topics: full names.
        own: publishers that `node` has for each of them; more under its name are another's.

    Returns:
        Sorted topics by each other node's full name.
    """
    here = _name(node.get_namespace(), node.get_name())
    found: dict[str, list[str]] = {}
    for topic in sorted(topics):
        ends = node.get_publishers_info_by_topic(topic)
        names = [_name(end.node_namespace, end.node_name) for end in ends]
        if names.count(here) <= own:
            names = [name for name in names if name != here]
        for name in sorted(set(names)):
            found.setdefault(name, []).append(topic)
    return dict(sorted(found.items()))


def _name(namespace: str, name: str) -> str:
    return f"{namespace.rstrip('/')}/{name}"


def listed(found: dict[str, list[str]]) -> str:
    """Return a text that names the nodes and their topics."""
    parts = []
    for name, topics in found.items():
        more = f" and {len(topics) - 1} more" if len(topics) > 1 else ""
        parts.append(f"{name} ({topics[0]}{more})")
    return ", ".join(parts)
