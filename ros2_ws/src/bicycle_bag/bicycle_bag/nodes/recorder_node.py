"""Records topics into a bag: a stand-in for `ros2 bag record` where there is none."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_bag.nodes.recorder_node")

import argparse
import contextlib
import os
import sys
import time
from collections.abc import Sequence
from datetime import datetime, timezone

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from bicycle_bag import __version__
from bicycle_bag.errors import BagError, OptionError
from bicycle_bag.mcap_file import COMPRESSIONS
from bicycle_bag.nodes.closing import LeftError, close, say
from bicycle_bag.nodes.lease import long_lease
from bicycle_bag.nodes.recorder import REST, Recorder
from bicycle_bag.nodes.session import further_node, ros_node
from bicycle_bag.qos_overrides import read_overrides
from bicycle_bag.selection import TopicFilter
from bicycle_bag.writer import BagWriter
from bicycle_common.command_line import FAILED, USAGE_ERROR, OneLineParser
from bicycle_common.nodes.runner import UserError, made_heartbeat
from bicycle_common.signals import StopRequest

SLOW_SYNC = 0.4
"""Longest sync with which a power cut costs less than a second (s)."""
INTERRUPTED = 130


def parse(arguments: Sequence[str]) -> tuple[argparse.Namespace, list[str]]:
    """Return the parsed command line and its ROS arguments."""
    parser = OneLineParser(
        prog="record.sh",
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
    """Return the bag's custom data: its origin and the user's `KEY=VALUE` entries.

    Raises:
        OptionError: An entry has no `=`.
    """
    data = {
        "recorder": f"bicycle_bag {__version__}",
        "started": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "ros_domain_id": os.environ.get("ROS_DOMAIN_ID", "0"),
    }
    for entry in entries:
        key, equals, value = entry.partition("=")
        if not (key and equals):
            raise OptionError(f"custom data {entry!r} has no '=': write it as key=value")
        data[key] = value
    return data


def record(options: argparse.Namespace, ros_arguments: Sequence[str]) -> str:
    """Record until a signal comes; returns the line that sums it up.

    Raises:
        BagError: An option is wrong, the directory exists, or the disk fails.
        LeftError: The user did not wait for the disk.
        UserError: The heartbeat's file cannot be written.
    """
    stop = StopRequest().listen()
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
    with (
        long_lease(),
        ros_node("bicycle_recorder", ros_arguments) as node,
        contextlib.ExitStack() as stack,
    ):
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

        def join() -> Node:
            return stack.enter_context(further_node("bicycle_recorder_again", ros_arguments))

        recorder = Recorder(node, writer, chosen, overrides, join)
        print(f"recording into {options.output}; Ctrl-C ends it", flush=True)
        while not stop.requested:
            executor.spin_once(timeout_sec=0.0)
            recorder.drain()
            recorder.notice_standstill()
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
    """Run the command `bicycle_record`; return its exit status."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        options, ros_arguments = parse(words)
        line = record(options, ros_arguments)
    except (OptionError, UserError) as error:
        say(str(error))
        return USAGE_ERROR
    except BagError as error:
        say(str(error))
        return FAILED
    except LeftError as error:
        say(str(error))
        return INTERRUPTED
    with contextlib.suppress(OSError):  # the terminal is gone
        print(line, flush=True)
    return 0
