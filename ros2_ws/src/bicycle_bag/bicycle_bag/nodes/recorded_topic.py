"""One topic on its way into the bag."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from bicycle_bag.metadata import Topic
from bicycle_bag.nodes.session import message_class, overridden_profile, subscription_profile
from bicycle_bag.ordering import Reorder
from bicycle_bag.qos import QosProfile, adapt
from bicycle_bag.reader import BagMessage

QUEUE = 10_000


class RecordedTopic:
    """One subscription and what it has heard.

    Args:
        node: that subscribes.
        topic: name, type and what its publishers offer.
        order: takes the messages.
        override: profile to subscribe with; None follows the publishers.

    Raises:
        BagError: The type is not installed here.
    """

    def __init__(
        self, node: Node, topic: Topic, order: Reorder, override: QosProfile | None = None
    ) -> None:
        self.topic = topic
        self.lost = 0
        self._node = node
        self._order = order
        self._override = override
        self._class = message_class(topic.type)
        self._last_sequence = 0
        self.reliable, self.transient_local = adapt(topic.qos)
        self._subscription = self._subscribe()

    def _profile(self) -> QoSProfile:
        if self._override is not None:
            return overridden_profile(self._override, QUEUE)
        return subscription_profile(self.reliable, self.transient_local, QUEUE)

    def _subscribe(self) -> Subscription:
        return self._node.create_subscription(
            self._class,
            self.topic.name,
            self._take,
            self._profile(),
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            raw=True,
        )

    def hear(self, offers: Sequence[QosProfile]) -> None:
        """Subscribe anew if a publisher has come that the present subscription cannot hear."""
        if not offers or self._override is not None:
            return
        reliable, transient_local = adapt(offers)
        reliable = reliable and self.reliable
        transient_local = transient_local and self.transient_local
        if (reliable, transient_local) != (self.reliable, self.transient_local):
            self.drain()
            self.reliable, self.transient_local = reliable, transient_local
            self._node.destroy_subscription(self._subscription)
            self._subscription = self._subscribe()
            self._node.get_logger().info(f"subscribed to {self.topic.name} anew, asking for less")

    def drain(self, until: float = math.inf) -> None:
        """Take all that has arrived, until a time in ns.

        One turn of the executor for each message would be too slow.
        """
        with self._subscription.handle:
            while (taken := self._subscription.handle.take_message(self._class, True)) is not None:
                if taken[1]["received_timestamp"] > until:
                    return
                self._take(*taken)

    def _take(self, data: bytes, info: dict[str, Any]) -> None:
        self._count_lost(info["publication_sequence_number"])
        received, sent = info["received_timestamp"], info["source_timestamp"]
        self._order.push(BagMessage(self.topic.name, self.topic.type, received, sent, data))

    def _count_lost(self, sequence: int | None) -> None:
        if sequence is None:
            return
        # Several publishers number their messages independently: only one can be followed.
        gap = self._last_sequence and sequence > self._last_sequence + 1
        if gap and self._subscription.get_publisher_count() == 1:
            self.lost += sequence - self._last_sequence - 1
        self._last_sequence = sequence
