"""One topic on its way into the bag."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile

from bicycle_bag.cutting import Cut, SourceClock
from bicycle_bag.metadata import Topic
from bicycle_bag.nodes.session import message_class, overridden_profile, subscription_profile
from bicycle_bag.nodes.taking import Taken, Taker
from bicycle_bag.ordering import Reorder
from bicycle_bag.qos import QosProfile
from bicycle_bag.reader import BagMessage
from bicycle_bag.stream import Stream

QUEUE = 10_000
"""Messages that the middleware holds for each subscription."""
REMEMBERED = 1000
"""Messages without a number that are remembered to drop repetitions."""
FLOW, FLOW_SECONDS = 5, 2.0
"""A topic flows that has brought so many messages in the last so many seconds."""

Quality = tuple[bool, bool]
"""True if a subscription asks for reliable publishers, and for transient-local ones."""


class _LeftAlone(CallbackGroup):
    """Group of subscriptions that executors leave alone: these take messages by rclpy."""

    def can_execute(self, entity: object) -> bool:
        return False

    def beginning_execution(self, entity: object) -> bool:
        return False

    def ending_execution(self, entity: object) -> None:
        pass


class TopicSubscription:
    """One subscription.

    Args:
        node: that subscribes.
        kind: class of the messages.
        name: the topic's name.
        quality: that it asks for.
        profile: the same, in full.
        take: is given this subscription and the message.
    """

    def __init__(
        self,
        node: Node,
        kind: type[Any],
        name: str,
        quality: Quality,
        profile: QoSProfile,
        take: Callable[[TopicSubscription, Taken], None],
    ) -> None:
        self.quality = quality
        self.profile = profile
        self._node = node
        self._take = take
        self._taker = Taker()
        self._subscription = node.create_subscription(
            kind,
            name,
            lambda _: None,
            profile,
            callback_group=_LeftAlone(),
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            raw=True,
        )

    @property
    def publishers(self) -> int:
        """Number of publishers that the subscription is matched with."""
        return int(self._subscription.get_publisher_count())

    def drain(self) -> None:
        """Take all that has arrived."""
        handle = self._subscription.handle
        with handle:
            while (taken := self._taker.take(handle)) is not None:
                self._take(self, taken)

    def close(self) -> None:
        """Take all that has arrived, and nothing more."""
        self.drain()
        self._node.destroy_subscription(self._subscription)


class RecordedTopic:
    """The subscriptions to one topic, and the messages that they received.

    Each reliability and durability on offer has its own subscription: a subscription receives only
    from publishers that offer at least what it requests, and one that requests less may lose
    messages. A message that two subscriptions receive is taken once, and each publisher's messages
    are counted by its own numbers, also after the middleware has lost it and met it again.

    Args:
        node: that subscribes.
        topic: name, type and what its publishers offer.
        offers: the same by publisher's id.
        order: takes the messages.
        override: profile to subscribe with; None follows the publishers.

    Attributes:
        missed: messages that the first publisher had sent before the first received one.
        passed: True if a message sent after `cut` has arrived.
        heard: s on the steady clock, when the last message was taken.

    Raises:
        BagError: The type is not installed here.
    """

    def __init__(
        self,
        node: Node,
        topic: Topic,
        offers: Mapping[bytes, QosProfile],
        order: Reorder,
        override: QosProfile | None = None,
    ) -> None:
        self.topic = topic
        self.missed = 0
        self.passed = self._flowed = False
        self._cut: Cut | None = None
        self._lately: deque[float] = deque(maxlen=FLOW)
        self.heard = 0.0
        self._node = node
        self._order = order
        self._class = message_class(topic.type)
        self._clock = SourceClock()
        self._received = 0
        self._streams: dict[bytes, Stream[BagMessage]] = {}
        self._qualities: dict[bytes, Quality] = {}
        self._known: deque[tuple[int, int]] = deque(maxlen=REMEMBERED)
        self._subscriptions: dict[Quality, TopicSubscription] = {}
        # Those of a node that has joined later, until they hear more publishers than the others.
        self._joining: dict[Quality, TopicSubscription] = {}
        # First number of each publisher that was sent after the cut.
        self._after: dict[bytes, int] = {}
        self._overridden = override is not None
        if override is not None:
            self._listen((False, False), overridden_profile(override, QUEUE))
        else:
            self.hear(offers)

    @property
    def lost(self) -> int:
        """Messages that publishers sent and that never arrived, between those that did.

        Those before the first message after the cut count, too: when they were sent is not known.
        """
        ends = (
            max(first - 1 - self._streams[publisher].last, 0)
            for publisher, first in self._after.items()
            if publisher in self._streams
        )
        return sum(stream.lost for stream in self._streams.values()) + sum(ends)

    def hear(self, offers: Mapping[bytes, QosProfile]) -> bool:
        """Subscribe to publishers with these offers; return True if that needed a subscription."""
        if self._overridden:
            return False
        qualities = {
            publisher: (offer.reliability == "reliable", offer.durability == "transient_local")
            for publisher, offer in offers.items()
        }
        self._qualities.update(qualities)
        new = sorted(set(qualities.values()) - self._subscriptions.keys(), reverse=True)
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
        if sum(one.publishers for one in self._joining.values()) > self.publishers:
            for quality in self._joining:
                self._subscriptions[quality].close()
            self._subscriptions, self._joining = {**self._subscriptions, **self._joining}, {}
        for subscription in list(self._subscriptions.values()):
            subscription.drain()

    def rejoin(self, node: Node) -> None:
        """Subscribe by a node that meets the publishers afresh, as soon as it hears more of them.

        The subscriptions until then are heard to their last message first, so that none is lost
        and none comes out of order.
        """
        self._node = node
        for subscription in self._joining.values():
            subscription.close()
        self._joining = {
            quality: self._subscription(quality, subscription.profile)
            for quality, subscription in self._subscriptions.items()
        }

    def _subscription(self, quality: Quality, profile: QoSProfile) -> TopicSubscription:
        return TopicSubscription(
            self._node, self._class, self.topic.name, quality, profile, self._take
        )

    def _listen(self, quality: Quality, profile: QoSProfile) -> None:
        self._subscriptions[quality] = self._subscription(quality, profile)
        # Those that ask for most come first.
        self._subscriptions = dict(sorted(self._subscriptions.items(), reverse=True))

    def rest(self) -> None:
        """Take the messages that still wait for earlier ones."""
        for stream in self._streams.values():
            self._push(stream.rest(), self._received)

    def _take(self, subscription: TopicSubscription, taken: Taken) -> None:
        data, received, sent, number, publisher = taken
        self._clock.add(received, sent, time.monotonic_ns())
        own = self._qualities.get(publisher) in (subscription.quality, None) or self._overridden
        if self._cut is not None and self._cut.is_before(self._clock.here(sent)):
            self.passed = self.passed or own
            if number is not None and own:
                self._after.setdefault(publisher, number)
            return
        message = BagMessage(self.topic.name, self.topic.type, received, sent, data)
        if number is None:
            due = [] if self._is_known((sent, hash(data))) else [message]
        else:
            if not self._streams and not subscription.quality[1]:
                self.missed = number - 1
            due = self._streams.setdefault(publisher, Stream()).take(number, message, own)
        self._received = received
        self._push(due, received)

    def _push(self, messages: list[BagMessage], received_ns: int) -> None:
        for message in messages:
            self.heard = time.monotonic()
            self._lately.append(self.heard)
            # Times of a topic that go back would look like a clock that was set back.
            self._order.push(message._replace(log_time_ns=received_ns))

    def _is_known(self, key: tuple[int, int]) -> bool:
        """Return True if another subscription has received the same message, without numbers."""
        if len(self._subscriptions) > 1 and key in self._known:
            return True
        self._known.append(key)
        return False
