"""Bicycles of the domain: which there are, and where those are that the pages do not steer."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from bicycle_msgs.msg import BicycleState
from rclpy.node import Node

from bicycle_cockpit.samples import plain
from bicycle_common.nodes import topics
from bicycle_common.nodes.topics import listen

LOOK_PERIOD = 1.0
"""Time between two looks for new bicycles (s)."""
SILENCE = 3.0
"""Time without a state after which a bicycle is drawn no more (s)."""
MOST = 50
"""Largest number of bicycles that are listed."""


def namespaces_of(names: Iterable[tuple[str, list[str]]]) -> list[str]:
    """Return the namespaces of the bicycles that have a state, in the order of their numbers.

    Args:
        names: topics with their types, as the graph tells them.
    """
    ending = f"/{topics.STATE.name}"
    kind = "bicycle_msgs/msg/BicycleState"
    found = {
        name.removesuffix(ending) or "/"
        for name, types in names
        if name.endswith(ending) and kind in types
    }
    return in_order(found)[:MOST]


def in_order(names: Iterable[str]) -> list[str]:
    """Return namespaces in the order of their numbers."""
    return sorted(names, key=lambda name: (len(name), name))


class OtherBicycles:
    """Finds the bicycles of a domain and keeps the newest place of each; for one thread.

    Args:
        node: that looks and subscribes.

    Attributes:
        names: namespaces of the bicycles, `/` for one without.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.names: list[str] = []
        self._subscriptions: dict[str, Any] = {}
        self._places: dict[str, tuple[BicycleState, float]] = {}
        self._looked = -LOOK_PERIOD

    def look(self, shown: str) -> None:
        """Look for bicycles, if it is time; subscribe to all but the shown one."""
        now = time.monotonic()
        if now - self._looked < LOOK_PERIOD:
            return
        self._looked = now
        self.names = [
            name
            for name in namespaces_of(self._node.get_topic_names_and_types())
            if self._node.count_publishers(_state_of(name)) > 0
        ]
        self.watch(shown)

    def watch(self, shown: str) -> None:
        """Subscribe to all bicycles but the shown one, whose states come anyway."""
        wanted = {name for name in self.names if name != shown}
        for name in set(self._subscriptions) - wanted:
            self._node.destroy_subscription(self._subscriptions.pop(name))
            self._places.pop(name, None)
        for name in wanted - set(self._subscriptions):
            topic = replace(topics.STATE, name=_state_of(name))

            def keep(state: BicycleState, name: str = name) -> None:
                self._places[name] = state, time.monotonic()

            self._subscriptions[name] = listen(self._node, topic, keep, depth=1)

    def message(self, shown: str) -> dict[str, Any]:
        """Return all names, and the places of those that are not shown, for the pages."""
        now = time.monotonic()
        others = [
            {
                "name": name,
                "x": plain(state.rear_contact.x),
                "y": plain(state.rear_contact.y),
                "heading": plain(state.heading),
                "steer": plain(state.steer_angle),
                "lean": plain(state.lean_angle),
                "fallen": bool(state.fallen),
            }
            for name, (state, heard) in self._places.items()
            if now - heard < SILENCE
        ]
        return {
            "type": "fleet",
            "shown": shown,
            "names": in_order({*self.names, shown}),
            "others": others,
        }


def _state_of(namespace: str) -> str:
    """Return the full name of a bicycle's state."""
    return f"{namespace.rstrip('/')}/{topics.STATE.name}"
