"""Records topics into a bag: a stand-in for ``ros2 bag record`` where there is none."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import time
from collections.abc import Mapping, Sequence
from datetime import datetime, timezone

from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from bicycle_bag import __version__
from bicycle_bag.arguments import OneLineParser
from bicycle_bag.errors import BagError
from bicycle_bag.mcap_file import COMPRESSIONS
from bicycle_bag.metadata import Topic
from bicycle_bag.nodes.closing import LeftError, close, say
from bicycle_bag.nodes.recorded_topic import RecordedTopic
from bicycle_bag.nodes.session import Stop, offered, ros_node
from bicycle_bag.ordering import Reorder
from bicycle_bag.qos import QosProfile
from bicycle_bag.qos_overrides import read_overrides
from bicycle_bag.reader import BagMessage
from bicycle_bag.schemas import Schemas
from bicycle_bag.selection import TopicFilter
from bicycle_bag.writer import BagWriter
from bicycle_sim.nodes.runner import UserError, made_heartbeat

DISCOVERY_SECONDS = 0.1
# How often a topic already recorded is asked for publishers of weaker quality.
RECHECK_POLLS = 10
# s; beyond this a power cut would have cost more than a second.
SLOW_SYNC = 0.4
# How often a loss is told.
TELL_POLLS = 10
# s between two turns of the executor, one of which takes longer than ten messages: what comes
# meanwhile waits in the subscription, with the time at which it came.
REST = 0.005
INTERRUPTED = 130


class Recorder:
    """Discovers topics, subscribes and hands what arrives to the writer, sorted by time."""

    def __init__(
        self,
        node: Node,
        writer: BagWriter,
        chosen: TopicFilter,
        overrides: Mapping[str, QosProfile],
    ) -> None:
        self.topics: dict[str, RecordedTopic] = {}
        self._overrides = overrides
        self._told: dict[str, int] = {}
        self._node = node
        self._writer = writer
        self._chosen = chosen
        self._schemas = Schemas()
        self._order = Reorder()
        self._refused: set[str] = set()
        self._polls = 0
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(DISCOVERY_SECONDS, self.poll, clock=steady)
        self.poll()

    @property
    def lost(self) -> int:
        """Messages that publishers sent and that never arrived here."""
        return sum(topic.lost for topic in self.topics.values())

    def poll(self) -> None:
        """Look for new topics and write what has come."""
        self._polls += 1
        for name, types in self._node.get_topic_names_and_types():
            if name in self._refused or not self._chosen.accepts(name, types[0]):
                continue
            if name not in self.topics:
                self._add(name, types)
            elif self._polls % RECHECK_POLLS == 0:
                self.topics[name].hear(self._offers(name))
        self._write(self._order.tick())
        self._writer.flush_if_due()
        if self._polls % TELL_POLLS == 0:
            self._tell_lost()

    def drain(self) -> None:
        """Take what has arrived."""
        for topic in self.topics.values():
            topic.drain()

    def finish(self) -> None:
        """Take what has arrived until now."""
        now = time.time_ns()
        for topic in self.topics.values():
            # Else a state could be in it without the command that led there, taken just before.
            topic.drain(now)
        self._write(self._order.rest())
        self._tell_lost()
        self._writer.custom_data["lost_messages"] = str(self.lost)

    def _tell_lost(self) -> None:
        """Warn of each topic that has lost messages since the last time."""
        for name, topic in self.topics.items():
            new = topic.lost - self._told.get(name, 0)
            if new:
                self._told[name] = topic.lost
                self._node.get_logger().warning(
                    f"{new} messages of {name} lost: too many for this recorder or the network; "
                    "record fewer topics, or best effort ones apart"
                )

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
            override = self._overrides.get(name)
            recorded = RecordedTopic(self._node, topic, self._order, override)
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


def parse(arguments: Sequence[str]) -> tuple[argparse.Namespace, list[str]]:
    """The command line, and what of it is ROS's."""
    parser = OneLineParser(
        prog="bicycle_record",
        description="Record topics into an MCAP bag that ros2 bag reads, until Ctrl-C.",
    )
    add = parser.add_argument
    name = datetime.now().strftime("rosbag2_%Y_%m_%d-%H_%M_%S")
    add("-o", "--output", default=name, help="directory to create (%(default)s)")
    add("-a", "--all", action="store_true", help="record all topics but hidden ones, as it does")
    add("--topics", nargs="+", default=[], help="record these")
    add("--topic-types", nargs="+", default=[], help="record topics of these types")
    add("-e", "--regex", default="", help="record topics in whose name this is found")
    add("-x", "--exclude", "--exclude-regex", default="", help="leave out topics that match")
    add("--exclude-topics", nargs="+", default=[], help="leave out these")
    add("--exclude-topic-types", nargs="+", default=[], help="leave out topics of these types")
    add("--include-hidden-topics", action="store_true", help="record hidden topics too")
    add("--compression", default="zstd", choices=list(COMPRESSIONS), help="(%(default)s)")
    add("-b", "--max-bag-size", type=int, default=0, help="bytes until a new file begins (never)")
    add("-d", "--max-bag-duration", type=float, default=0.0, help="s until a new file (never)")
    add("--qos-profile-overrides-path", default="", metavar="FILE", help="YAML, as ros2 bag's")
    add("--custom-data", nargs="+", default=[], metavar="KEY=VALUE", help="for metadata.yaml")
    return parser.parse_with_ros(arguments)


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
        LeftError: The user did not wait for the disk.
        UserError: The heartbeat's file cannot be written.
    """
    stop = Stop()
    chosen = TopicFilter(
        options.topics,
        options.regex,
        options.exclude,
        options.exclude_topics,
        options.include_hidden_topics,
        options.topic_types,
        options.exclude_topic_types,
    )
    overrides = read_overrides(options.qos_profile_overrides_path)
    data = custom_data(options.custom_data)
    heart = made_heartbeat()
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
        recorder = Recorder(node, writer, chosen, overrides)
        print(f"recording into {options.output}; Ctrl-C ends it", flush=True)
        while not stop.requested:
            executor.spin_once(timeout_sec=DISCOVERY_SECONDS)
            recorder.drain()
            heart.beat()
            time.sleep(REST)
        recorder.finish()
        executor.shutdown()
    bag = close(writer, stop, options.output)
    if writer.slowest_sync > SLOW_SYNC:
        say(
            f"the disk took up to {writer.slowest_sync:.1f} s to take what was written: a power "
            "cut would have cost so much more than a second; record onto a faster one"
        )
    return (
        f"recorded {bag.message_count} messages of {len(bag.topics)} topics in "
        f"{time.monotonic() - began:.1f} s, {recorder.lost} lost on the way: {options.output}"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """The command ``bicycle_record``; returns its exit status."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        options, ros_arguments = parse(words)
        line = record(options, ros_arguments)
    except (BagError, UserError) as error:
        say(str(error))
        return 1
    except LeftError as error:
        say(str(error))
        return INTERRUPTED
    with contextlib.suppress(OSError):  # the terminal is gone
        print(line, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
