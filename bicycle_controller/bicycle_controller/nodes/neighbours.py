"""The other bicycles: the newest odometry of each, looked at ten times a second."""

from __future__ import annotations

import math
import time
from collections.abc import MutableMapping, Sequence
from typing import Any

import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from bicycle_common.geometry import yaw_to_heading
from bicycle_common.nodes import convert, topics
from bicycle_controller.control.keep_clear import LOOK_PERIOD, Mover
from bicycle_controller.control.track import Track

FORGOTTEN = 2.0
"""Time after which a silent bicycle is no longer kept clear of (s)."""


class Neighbours:
    """Reads the odometry of other bicycles without a callback for each message.

    The subscriptions belong to a hidden node that no executor spins: of the 40 messages a second
    of each bicycle the middleware keeps the newest one, and Python converts a quarter of them.
    """

    def __init__(
        self, node: Node, names: Sequence[str], movers: MutableMapping[str, Mover]
    ) -> None:
        """Subscribe.

        Args:
            node: the controller's node, whose executor looks.
            names: namespaces of the other bicycles.
            movers: filled with those that are heard.
        """
        self._names, self._movers = tuple(names), movers
        self._heard: dict[str, float] = {}
        self._tracks: dict[str, Track] = {}
        self._ears: Node | None = None
        if not names:
            return
        self._ears = Node(
            f"_{node.get_name()}_neighbours",
            namespace=node.get_namespace(),
            context=node.context,
            enable_rosout=False,
            start_parameter_services=False,
        )
        kind = topics.ODOMETRY.type
        self._subscriptions = {
            name: self._ears.create_subscription(
                kind, f"/{name}/{topics.ODOMETRY.name}", lambda message: None, 1
            )
            for name in names
        }
        node.create_timer(LOOK_PERIOD, self.look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    @property
    def unheard(self) -> list[str]:
        """Names of the bicycles without a received state."""
        return [name for name in self._names if name not in self._heard]

    def look(self) -> None:
        """Take the newest message of each bicycle; forget those that are silent."""
        now = time.monotonic()
        for name, subscription in self._subscriptions.items():
            with subscription.handle:
                taken = subscription.handle.take_message(topics.ODOMETRY.type, False)
            if taken is not None:
                self._hear(name, taken[0], now)
            if now - self._heard.get(name, now) > FORGOTTEN:
                del self._heard[name], self._movers[name]
                self._tracks.pop(name, None)

    def _hear(self, name: str, message: Any, now: float) -> None:
        """Keep the pose and the speed of a message."""
        place, twist = message.pose.pose.position, message.twist.twist
        try:
            heading = float(yaw_to_heading(convert.to_yaw(message.pose.pose.orientation)))
        except ValueError:
            return  # no orientation: it counts as silent, which diagnostics tell
        numbers = float(place.x), float(place.y), heading, float(twist.linear.x)
        if all(map(math.isfinite, numbers)):
            stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
            track = self._tracks.setdefault(name, Track())
            x, y, heading, told = numbers
            speed = track.speed(now, stamp, (x, y), heading, told)
            numbers = x, y, heading, speed
            self._movers[name] = Mover(*(np.array([value]) for value in numbers))
            self._heard[name] = now

    def close(self) -> None:
        """Destroy the hidden node."""
        if self._ears is not None:
            self._ears.destroy_node()
            self._ears = None
