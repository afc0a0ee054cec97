"""Recording: from topics to the writer of a bag."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from datetime import datetime, timezone

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from bicycle_bag.cutting import LONGEST_END, Cut, SetBack
from bicycle_bag.errors import BagError
from bicycle_bag.metadata import Topic
from bicycle_bag.nodes.recorded_topic import RecordedTopic
from bicycle_bag.nodes.session import offered
from bicycle_bag.ordering import Reorder
from bicycle_bag.qos import QosProfile
from bicycle_bag.reader import BagMessage
from bicycle_bag.schemas import Schemas
from bicycle_bag.selection import TopicFilter
from bicycle_bag.writer import BagWriter

DISCOVERY_SECONDS = 0.1
RECHECK_POLLS = 10
"""Polls between two searches for publishers of another quality on a recorded topic."""
TELL_POLLS = 10
"""Polls between two reports of losses."""
REST = 0.02
"""Sleep between turns (s). One turn costs more than reading ten messages, so let them queue; the
middleware keeps their receive time."""
QUIET = 0.5
"""Time without a message from before the end after which none is missing (s): on a busy machine
some arrive late, and lost packets are sent again after 10 ms."""
STANDSTILL = 3.0
"""Shortest gap between two turns that is reported (s)."""
REJOIN = 20.0
"""Longest wait at the end for publishers that a standstill has cost (s)."""
PARTED = 6.0
"""Time after which a new node meets publishers that a standstill has cost (s).

They are met again within a second, mostly, and then give what they have kept; with a new node that
is lost. But Fast DDS 2.14 may take in an announcement while it still removes the publisher, and
does not meet it again then.
"""


class Recorder:
    """Discovers topics, subscribes and hands what arrives to the writer, sorted by time.

    Args:
        node: that subscribes.
        writer: the bag's writer.
        chosen: which topics to record.
        overrides: profiles to subscribe with, by topic.
        join: returns a node that meets all publishers afresh.
    """

    def __init__(
        self,
        node: Node,
        writer: BagWriter,
        chosen: TopicFilter,
        overrides: Mapping[str, QosProfile],
        join: Callable[[], Node],
    ) -> None:
        self.topics: dict[str, RecordedTopic] = {}
        self._overrides = overrides
        self._told: dict[str, int] = {}
        self._told_missed: set[str] = set()
        self._node = node
        self._join = join
        self._writer = writer
        self._chosen = chosen
        self._schemas = Schemas()
        self._order = Reorder()
        self._refused: set[str] = set()
        self._begun: set[str] = set()
        self._polls = 0
        self._turned = time.clock_gettime(time.CLOCK_BOOTTIME)
        self._turned_steady = self._awake = time.monotonic()
        self._matched: dict[str, int] = {}
        # How many publishers each topic had before a standstill, for topics that lost some by it.
        self._before_standstill: dict[str, int] = {}
        self._rejoined = False
        self._set_back = SetBack()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(DISCOVERY_SECONDS, self.poll, clock=steady)
        self.poll()

    @property
    def lost(self) -> int:
        """Messages that publishers sent and that never arrived here."""
        return sum(topic.lost for topic in self.topics.values())

    def poll(self) -> None:
        """Look for new topics and write the messages that have arrived."""
        self.notice_standstill()
        self._polls += 1
        for name, types in self._node.get_topic_names_and_types():
            if name in self._refused or not self._chosen.accepts(name, types[0]):
                continue
            if name not in self.topics:
                self._add(name, types)
            elif self._polls % RECHECK_POLLS == 0 and self.topics[name].hear(self._offers(name)):
                self._node.get_logger().info(
                    f"{name} has publishers of another quality now: subscribed to these, too"
                )
        self._write(self._order.tick())
        self._writer.flush_if_due()
        if self._polls % TELL_POLLS == 0:
            self._tell()
        if not self._absent():
            self._matched = {name: topic.publishers for name, topic in self.topics.items()}

    def drain(self) -> None:
        """Process the messages that have arrived."""
        for topic in self.topics.values():
            topic.drain()

    def notice_standstill(self) -> None:
        """Warn if this process has not run for a while; call it in each turn.

        Publishers have announced themselves in vain meanwhile, so the middleware may drop them
        before it hears them again.
        """
        self._set_back.look()
        # Unlike the other clocks, this one runs while the machine sleeps.
        now, steady = time.clock_gettime(time.CLOCK_BOOTTIME), time.monotonic()
        still, self._turned = now - self._turned, now
        still_steady, self._turned_steady = steady - self._turned_steady, steady
        if still > STANDSTILL:
            self._awake, self._before_standstill = steady, dict(self._matched)
            self._rejoined = False
            for topic in self.topics.values():
                topic.stood_still(still_steady)
            self._node.get_logger().warning(
                f"stood still for {still:.1f} s, stopped or with a machine that slept: what its "
                "publishers did not keep meanwhile is lost"
            )

    def _absent(self) -> list[str]:
        """Return the topics that had more publishers before a standstill of a moment ago."""
        if self._before_standstill and time.monotonic() - self._awake > REJOIN:
            self._node.get_logger().warning(
                f"publishers of {', '.join(self._before_standstill)} did not come back after the "
                "standstill: they have ended, or what they sent since is lost"
            )
            self._before_standstill = {}
        self._before_standstill = {
            name: count
            for name, count in self._before_standstill.items()
            if self.topics[name].publishers < count
        }
        absent = list(self._before_standstill)
        if absent and not self._rejoined and time.monotonic() - self._awake > PARTED:
            self._rejoin(absent)
        return absent

    def _rejoin(self, topics: list[str]) -> None:
        """Meet the publishers of these topics by a new node, without what they have kept."""
        self._node.get_logger().warning(
            f"publishers of {', '.join(topics)} have not come back after the standstill: they "
            "have ended, or the middleware does not meet them again; joins anew, what they sent "
            "until then is lost"
        )
        self._rejoined, self._node = True, self._join()
        for name in topics:
            self.topics[name].rejoin(self._node)

    def finish(self) -> None:
        """Take the messages sent until now, however late they arrive, and no later ones.

        An active topic is complete when a message sent later arrives. Otherwise the bag could hold
        a state without the command that led to it, which was sent earlier and arrives later.
        """
        self.notice_standstill()
        if absent := self._absent():
            self._node.get_logger().info(
                f"waits {REJOIN:g} s at most for publishers of {', '.join(absent)}, which a "
                "standstill has cost"
            )
        cut, began = Cut(time.time_ns(), self._set_back.look()), time.monotonic()
        for topic in self.topics.values():
            topic.cut(cut)
        while True:
            self.drain()
            now = time.monotonic()
            if self._absent():
                began = now  # they keep what they have sent until they meet this recorder again
                time.sleep(REST)
                continue
            last = max([began, *(topic.heard for topic in self.topics.values())])
            # No message arrives either while this process or the network is stalled.
            waiting = any(topic.waits for topic in self.topics.values())
            complete = all(topic.passed for topic in self.topics.values())
            quiet = now - last > QUIET and not waiting
            if complete or quiet or now - began > LONGEST_END:
                break
            time.sleep(REST)
        for topic in self.topics.values():
            topic.rest()
        self._write(self._order.rest())
        self._tell()
        ended = datetime.fromtimestamp(cut.time_ns * 1e-9, timezone.utc)
        self._writer.custom_data["ended"] = ended.isoformat(timespec="milliseconds")
        self._writer.custom_data["lost_messages"] = str(self.lost)

    def _tell(self) -> None:
        """Report each topic's new losses, and where it begins."""
        for name, topic in self.topics.items():
            if topic.missed and name not in self._told_missed:
                self._told_missed.add(name)
                self._node.get_logger().info(
                    f"{name} begins with message {topic.missed + 1} of its publisher: those "
                    "before were sent before they could be heard"
                )
            new = topic.lost - self._told.get(name, 0)
            if new > 0:
                self._told[name] = topic.lost
                self._node.get_logger().warning(
                    f"{new} messages of {name} lost: too many for this recorder or the network; "
                    "record fewer topics, or best effort ones apart"
                )

    def _offers(self, name: str) -> dict[bytes, QosProfile]:
        publishers = self._node.get_publishers_info_by_topic(name)
        return {bytes(one.endpoint_gid): offered(one.qos_profile) for one in publishers}

    def _add(self, name: str, types: list[str]) -> None:
        publishers = self._node.get_publishers_info_by_topic(name)
        if not publishers:
            return
        try:
            if len(types) > 1:
                raise BagError(f"it has several types ({', '.join(types)}): stop one publisher")
            known = str(publishers[0].topic_type_hash)
            type_hash = known if known.startswith("RIHS") else self._schemas.type_hash(types[0])
            offers = {bytes(one.endpoint_gid): offered(one.qos_profile) for one in publishers}
            topic = Topic(name, types[0], tuple(offers.values()), type_hash)
            definition = self._schemas.definition(types[0])
            override = self._overrides.get(name)
            recorded = RecordedTopic(self._node, topic, offers, self._order, override)
        except BagError as error:
            self._refused.add(name)
            self._node.get_logger().warning(f"{name} is not recorded: {error}")
            return
        self._writer.add_topic(topic, definition)
        self.topics[name] = recorded
        self._node.get_logger().info(f"recording {name} ({types[0]})")

    def _write(self, messages: list[BagMessage]) -> None:
        for message in messages:
            if message.topic not in self._begun:
                self._begun.add(message.topic)
                self._node.get_logger().info(f"{message.topic}: first message")
            self._writer.write(
                message.topic, message.data, message.log_time_ns, message.publish_time_ns
            )
