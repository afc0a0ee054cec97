"""Records topics into a bag: a stand-in for ``ros2 bag record`` where there is none."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from datetime import datetime, timezone
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.utilities import remove_ros_args

from bicycle_bag import __version__
from bicycle_bag.arguments import OneLineParser
from bicycle_bag.errors import BagError
from bicycle_bag.mcap_file import COMPRESSIONS
from bicycle_bag.metadata import BagMetadata, Topic
from bicycle_bag.nodes.session import (
    Stop,
    heartbeat,
    message_class,
    offered,
    ros_node,
    subscription_profile,
)
from bicycle_bag.ordering import Reorder
from bicycle_bag.qos import QosProfile, adapt
from bicycle_bag.reader import BagMessage
from bicycle_bag.schemas import Schemas
from bicycle_bag.selection import TopicFilter
from bicycle_bag.writer import BagWriter

DISCOVERY_SECONDS = 0.1
# How often a topic already recorded is asked for publishers of weaker quality.
RECHECK_POLLS = 10
QUEUE = 1000


class RecordedTopic:
    """One subscription and what it has heard."""

    def __init__(self, node: Node, topic: Topic, order: Reorder) -> None:
        self.topic = topic
        self.lost = 0
        self._node = node
        self._order = order
        self._class = message_class(topic.type)
        self._last_sequence = 0
        self.reliable, self.transient_local = adapt(topic.qos)
        self._subscription = self._subscribe()

    def _subscribe(self) -> Subscription:
        return self._node.create_subscription(
            self._class,
            self.topic.name,
            self._on_message,
            subscription_profile(self.reliable, self.transient_local, QUEUE),
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            raw=True,
        )

    def hear(self, offers: Sequence[QosProfile]) -> None:
        """Subscribe anew if a publisher has come that the present subscription cannot hear."""
        if not offers:
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

    def drain(self) -> None:
        """Take all that has arrived; one turn of the executor for each would be too slow."""
        with self._subscription.handle:
            while (taken := self._subscription.handle.take_message(self._class, True)) is not None:
                self._take(*taken)

    def _on_message(self, data: bytes, info: dict[str, Any]) -> None:
        self._take(data, info)
        self.drain()

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


class Recorder:
    """Discovers topics, subscribes and hands what arrives to the writer, sorted by time."""

    def __init__(self, node: Node, writer: BagWriter, chosen: TopicFilter) -> None:
        self.topics: dict[str, RecordedTopic] = {}
        self._node = node
        self._writer = writer
        self._chosen = chosen
        self._schemas = Schemas()
        self._order = Reorder()
        self._refused: set[str] = set()
        self._polls = 0
        node.create_timer(DISCOVERY_SECONDS, self.poll)
        self.poll()

    @property
    def lost(self) -> int:
        """Messages that publishers sent and that never arrived here."""
        return sum(topic.lost for topic in self.topics.values())

    def poll(self) -> None:
        """Look for new topics and write what has come."""
        self._polls += 1
        for name, types in self._node.get_topic_names_and_types():
            if name in self._refused or not self._chosen.accepts(name):
                continue
            if name not in self.topics:
                self._add(name, types)
            elif self._polls % RECHECK_POLLS == 0:
                self.topics[name].hear(self._offers(name))
        self._write(self._order.tick())
        self._writer.flush_if_due()

    def finish(self) -> BagMetadata:
        """Take what has arrived meanwhile and close the bag."""
        for topic in self.topics.values():
            topic.drain()
        self._write(self._order.rest())
        return self._writer.close()

    def _offers(self, name: str) -> list[QosProfile]:
        publishers = self._node.get_publishers_info_by_topic(name)
        return [offered(publisher.qos_profile) for publisher in publishers]

    def _add(self, name: str, types: list[str]) -> None:
        publishers = self._node.get_publishers_info_by_topic(name)
        if not publishers:
            return
        try:
            if len(types) > 1:
                raise BagError(f"it has several types ({', '.join(types)}): stop one publisher")
            known = str(publishers[0].topic_type_hash)
            type_hash = known if known.startswith("RIHS") else self._schemas.type_hash(types[0])
            offers = tuple(offered(publisher.qos_profile) for publisher in publishers)
            topic = Topic(name, types[0], offers, type_hash)
            definition = self._schemas.definition(types[0])
            recorded = RecordedTopic(self._node, topic, self._order)
        except BagError as error:
            self._refused.add(name)
            self._node.get_logger().warning(f"{name} is not recorded: {error}")
            return
        self._writer.add_topic(topic, definition)
        self.topics[name] = recorded
        self._node.get_logger().info(f"recording {name} ({types[0]})")

    def _write(self, messages: list[BagMessage]) -> None:
        for message in messages:
            self._writer.write(
                message.topic, message.data, message.log_time_ns, message.publish_time_ns
            )


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """The command line, without ROS arguments."""
    parser = OneLineParser(
        prog="bicycle_record",
        description="Record topics into an MCAP bag that ros2 bag reads, until Ctrl-C.",
    )
    add = parser.add_argument
    name = datetime.now().strftime("rosbag2_%Y_%m_%d-%H_%M_%S")
    add("-o", "--output", default=name, help="directory to create (%(default)s)")
    add("--topics", nargs="+", default=[], help="record these (all but hidden ones)")
    add("-e", "--regex", default="", help="record topics in whose name this is found")
    add("-x", "--exclude", "--exclude-regex", default="", help="leave out topics that match")
    add("--exclude-topics", nargs="+", default=[], help="leave out these")
    add("--include-hidden-topics", action="store_true", help="record hidden topics too")
    add("--compression", default="zstd", choices=list(COMPRESSIONS), help="(%(default)s)")
    add("-b", "--max-bag-size", type=int, default=0, help="bytes until a new file begins (never)")
    add("-d", "--max-bag-duration", type=float, default=0.0, help="s until a new file (never)")
    add("--custom-data", nargs="+", default=[], metavar="KEY=VALUE", help="for metadata.yaml")
    return parser.parse_args(arguments)


def custom_data(entries: Sequence[str]) -> dict[str, str]:
    """What the bag says of its making, with the user's ``KEY=VALUE`` entries.

    Raises:
        BagError: An entry has no ``=``.
    """
    data = {
        "recorder": f"bicycle_bag {__version__}",
        "started": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "ros_domain_id": os.environ.get("ROS_DOMAIN_ID", "0"),
    }
    for entry in entries:
        key, equals, value = entry.partition("=")
        if not (key and equals):
            raise BagError(f"custom data {entry!r} has no '=': write it as key=value")
        data[key] = value
    return data


def record(options: argparse.Namespace, ros_arguments: Sequence[str]) -> str:
    """Record until a signal comes; returns the line that sums it up.

    Raises:
        BagError: An option is wrong, the directory exists, or the disk fails.
    """
    stop = Stop()
    chosen = TopicFilter(
        options.topics,
        options.regex,
        options.exclude,
        options.exclude_topics,
        options.include_hidden_topics,
    )
    data = custom_data(options.custom_data)
    heart = heartbeat()
    with ros_node("bicycle_recorder", ros_arguments) as node:
        writer = BagWriter(
            options.output,
            compression=options.compression,
            split_bytes=options.max_bag_size,
            split_seconds=options.max_bag_duration,
            custom_data=data,
        )
        began = time.monotonic()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        recorder = Recorder(node, writer, chosen)
        print(f"recording into {options.output}; Ctrl-C ends it", flush=True)
        while not stop.requested:
            executor.spin_once(timeout_sec=DISCOVERY_SECONDS)
            heart.beat()
        bag = recorder.finish()
        executor.shutdown()
    return (
        f"recorded {bag.message_count} messages of {len(bag.topics)} topics in "
        f"{time.monotonic() - began:.1f} s, {recorder.lost} lost on the way: {options.output}"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """The command ``bicycle_record``; returns its exit status."""
    words = list(sys.argv if arguments is None else ["bicycle_record", *arguments])
    options = parse(remove_ros_args(words)[1:])
    try:
        print(record(options, words), flush=True)
    except BagError as error:
        print(f"bicycle_record: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
