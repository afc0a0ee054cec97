"""Relay of one topic to Foxglove: its bytes and its definition, unconverted."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence

import foxglove
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.subscription import Subscription

from bicycle_bag.nodes.session import message_class, offered, subscription_profile
from bicycle_bag.qos import QosProfile, adapt
from bicycle_bag.schemas import Schemas

QUEUE = 100
MOST_KEPT = 10
"""Messages of a latched topic kept for clients that subscribe later."""


class Relay:
    """Subscribes to a topic while a client watches it.

    Args:
        node: that subscribes.
        name: the topic's name.
        kind: `pkg/msg/Type`.
        context: the server's context.
        schemas: where definitions are found.

    Raises:
        BagError: if the type is not installed.
    """

    def __init__(
        self, node: Node, name: str, kind: str, context: foxglove.Context, schemas: Schemas
    ) -> None:
        self._node, self._name = node, name
        self._class = message_class(kind)
        text = schemas.definition(kind).encode()
        schema = foxglove.Schema(name=kind, encoding="ros2msg", data=text)
        self._channel = foxglove.Channel(
            name, schema=schema, message_encoding="cdr", context=context
        )
        self._watchers = 0
        self._subscription: Subscription | None = None
        self._asked = (False, False)
        self._kept: deque[bytes] = deque(maxlen=MOST_KEPT)

    @property
    def channel_id(self) -> int:
        """Number of the channel on the server."""
        return self._channel.id()

    def watch(self) -> None:
        """Start to relay for a new client: the latched messages, then new ones."""
        self._watchers += 1
        if self._subscription is None:
            self._subscribe(adapt(self._offers()))
        else:
            for data in self._kept:
                self._channel.log(data, log_time=time.time_ns())

    def unwatch(self) -> None:
        """Count a client that has left."""
        self._watchers = max(0, self._watchers - 1)
        if self._watchers == 0:
            self._unsubscribe()

    def look(self) -> None:
        """Resubscribe if the current subscription cannot receive a new publisher."""
        offers = self._offers()
        if self._subscription is not None and offers and adapt(offers) != self._asked:
            self._unsubscribe()
            self._subscribe(adapt(offers))

    def _offers(self) -> Sequence[QosProfile]:
        found = self._node.get_publishers_info_by_topic(self._name)
        return [offered(publisher.qos_profile) for publisher in found]

    def _subscribe(self, asked: tuple[bool, bool]) -> None:
        self._asked = asked
        self._subscription = self._node.create_subscription(
            self._class,
            self._name,
            self._on_message,
            subscription_profile(*asked, QUEUE),
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            raw=True,
        )

    def _unsubscribe(self) -> None:
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
        self._subscription = None
        self._kept.clear()

    def _on_message(self, data: bytes) -> None:
        if self._asked[1]:
            self._kept.append(data)
        self._channel.log(data, log_time=time.time_ns())
