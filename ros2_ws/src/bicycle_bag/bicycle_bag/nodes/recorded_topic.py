"""One topic on its way into the bag."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile

from bicycle_bag.cutting import Cut, SourceClock
from bicycle_bag.metadata import Topic
from bicycle_bag.nodes.session import message_class, overridden_profile, subscription_profile
from bicycle_bag.ordering import Reorder
from bicycle_bag.qos import QosProfile
from bicycle_bag.reader import BagMessage

QUEUE = 10_000
"""Messages that the middleware holds for each subscription."""
REMEMBERED = 1000
"""Number of messages remembered to drop repetitions, with one subscription; `QUEUE` with more."""
FLOW, FLOW_SECONDS = 5, 2.0
"""A topic flows that has brought so many messages in the last so many seconds."""

Quality = tuple[bool, bool]
"""True if a subscription asks for reliable publishers, and for transient-local ones."""


class TopicSubscription:
    """One subscription.

    Args:
        node: that subscribes.
        kind: class of the messages.
        name: the topic's name.
        quality: that it asks for.
        profile: the same, in full.
        take: is given this subscription, the message and what the middleware says of it.
    """

    def __init__(
        self,
        node: Node,
        kind: type[Any],
        name: str,
        quality: Quality,
        profile: QoSProfile,
        take: Callable[[TopicSubscription, bytes, dict[str, Any]], None],
    ) -> None:
        self.latched = quality[1]
        self.last_sequence = 0
        self._kind, self._take = kind, take
        self._subscription = node.create_subscription(
            kind,
            name,
            self.hear,
            profile,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            raw=True,
        )

    @property
    def publishers(self) -> int:
        """Number of publishers that the subscription is matched with."""
        return int(self._subscription.get_publisher_count())

    def hear(self, data: bytes, info: dict[str, Any]) -> None:
        """Hand a message over."""
        self._take(self, data, info)

    def drain(self) -> None:
        """Take all that has arrived; one turn of the executor for each would be too slow."""
        handle = self._subscription.handle
        with handle:
            while (taken := handle.take_message(self._kind, True)) is not None:
                self._take(self, *taken)


class RecordedTopic:
    """The subscriptions to one topic, and the messages that they received.

    Each reliability and durability on offer has its own subscription: a subscription receives only
    from publishers that offer at least what it requests, and one that requests less may lose
    messages. A message that two subscriptions receive is taken once.

    Args:
        node: that subscribes.
        topic: name, type and what its publishers offer.
        order: takes the messages.
        override: profile to subscribe with; None follows the publishers.

    Attributes:
        lost: messages that a publisher sent and that never arrived.
        missed: messages that the first publisher had sent before the first received one.
        passed: True if a message sent after `cut` has arrived.
        heard: s on the steady clock, when the last message was taken.

    Raises:
        BagError: The type is not installed here.
    """

    def __init__(
        self, node: Node, topic: Topic, order: Reorder, override: QosProfile | None = None
    ) -> None:
        self.topic = topic
        self.lost = self.missed = 0
        self.passed = self._flowed = False
        self._cut: Cut | None = None
        self._lately: deque[float] = deque(maxlen=FLOW)
        self.heard = 0.0
        self._node = node
        self._order = order
        self._class = message_class(topic.type)
        self._clock = SourceClock()
        self._known: set[tuple[int, int]] = set()
        self._known_in_order: deque[tuple[int, int]] = deque()
        self._subscriptions: dict[Quality, TopicSubscription] = {}
        self._overridden = override is not None
        if override is not None:
            self._listen((False, False), overridden_profile(override, QUEUE))
        else:
            self.hear(topic.qos)

    def hear(self, offers: Sequence[QosProfile]) -> bool:
        """Subscribe to publishers with these offers; return True if that needed a subscription."""
        if self._overridden:
            return False
        wanted = {
            (offer.reliability == "reliable", offer.durability == "transient_local")
            for offer in offers
        }
        new = sorted(wanted - self._subscriptions.keys(), reverse=True)
        for quality in new:
            self._listen(quality, subscription_profile(*quality, QUEUE))
        return bool(new)

    def cut(self, moment: Cut) -> None:
        """End the recording: leave out messages sent after this moment."""
        self._cut = moment
        often = len(self._lately) == FLOW
        self._flowed = often and time.monotonic() - self._lately[0] < FLOW_SECONDS

    def stood_still(self, seconds: float) -> None:
        """Leave out a time in which nothing could be heard of how active the topic is."""
        self._lately = deque((moment + seconds for moment in self._lately), maxlen=FLOW)

    @property
    def publishers(self) -> int:
        """Number of publishers that any subscription is matched with."""
        return sum(subscription.publishers for subscription in self._subscriptions.values())

    @property
    def waits(self) -> bool:
        """True if the topic was active at the end, and no message sent later has arrived yet."""
        return self._flowed and not self.passed and self.publishers > 0

    def drain(self) -> None:
        """Take all that has arrived."""
        for subscription in list(self._subscriptions.values()):
            subscription.drain()

    def _listen(self, quality: Quality, profile: QoSProfile) -> None:
        self._subscriptions[quality] = TopicSubscription(
            self._node, self._class, self.topic.name, quality, profile, self._take
        )
        # Those that ask for most come first.
        self._subscriptions = dict(sorted(self._subscriptions.items(), reverse=True))

    def _take(self, subscription: TopicSubscription, data: bytes, info: dict[str, Any]) -> None:
        received, sent = info["received_timestamp"], info["source_timestamp"]
        sequence = info["publication_sequence_number"]
        self._clock.add(received, sent, time.monotonic_ns())
        if self._cut is not None and self._cut.is_before(self._clock.here(sent)):
            self.passed = True
            return
        self._count(subscription, sequence)
        # Some middleware gives no sequence number: equal messages are repetitions then.
        if self._is_known((sent, hash(data) if sequence is None else sequence)):
            return
        self.heard = time.monotonic()
        self._lately.append(self.heard)
        self._order.push(BagMessage(self.topic.name, self.topic.type, received, sent, data))

    def _is_known(self, key: tuple[int, int]) -> bool:
        """Return True if another subscription has received the same message."""
        if key in self._known:
            return len(self._subscriptions) > 1
        self._known.add(key)
        self._known_in_order.append(key)
        most = REMEMBERED if len(self._subscriptions) == 1 else QUEUE
        while len(self._known_in_order) > most:
            self._known.discard(self._known_in_order.popleft())
        return False

    def _count(self, subscription: TopicSubscription, sequence: int | None) -> None:
        """Count the messages that a publisher numbered and no subscription received."""
        if sequence is None:
            return
        last, subscription.last_sequence = subscription.last_sequence, sequence
        if not last and not self._known and not subscription.latched:
            self.missed = sequence - 1
        # Several publishers number their messages independently: only one can be followed.
        if (
            last
            and sequence > last + 1
            and subscription.publishers == 1
            and self._is_best(subscription)
        ):
            self.lost += sequence - last - 1

    def _is_best(self, subscription: TopicSubscription) -> bool:
        """Return True if no less lossy subscription receives a publisher."""
        return (
            next(
                one
                for one in self._subscriptions.values()
                if one is subscription or one.publishers
            )
            is subscription
        )
