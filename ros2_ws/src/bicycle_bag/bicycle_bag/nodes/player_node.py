"""Publishes a bag again: a stand-in for ``ros2 bag play`` where there is none."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from tqdm import tqdm

from bicycle_bag.arguments import OneLineParser
from bicycle_bag.errors import BagError
from bicycle_bag.nodes.session import Stop, message_class, publisher_profile, ros_node
from bicycle_bag.playback import CLOCK, ClockTick, Playback, PlayOptions
from bicycle_bag.reader import BagReader
from bicycle_sim.nodes.runner import UserError, without_ros

QUEUE = 1000
LATCHED = 10
ACKNOWLEDGE_SECONDS = 1.0
BAR_SECONDS = 0.1


class Player:
    """Publishers for a bag's topics, and the loop that serves them in time."""

    def __init__(self, node: Node, reader: BagReader, playback: Playback, clock: bool) -> None:
        self.published = 0
        self._playback = playback
        self._publishers: dict[str, Publisher] = {}
        for name in playback.topics:
            topic = reader.topics[name]
            try:
                kind = message_class(topic.type)
            except BagError as error:
                node.get_logger().warning(f"{name} is not played: {error}")
                continue
            profile = publisher_profile(topic.qos, QUEUE, LATCHED)
            self._publishers[name] = node.create_publisher(kind, name, profile)
        if not self._publishers:
            raise BagError("no topic can be played: source the workspace that has their types")
        self._clock = node.create_publisher(Clock, CLOCK, LATCHED) if clock else None

    def play(self, stop: Stop) -> None:
        """Publish everything once, each message when it is due; ends early on a signal."""
        began = drawn = time.monotonic()
        shown = "{l_bar}{bar}| {n:.1f}/{total:.1f} s of the bag [{elapsed}<{remaining}]"
        with tqdm(total=self._playback.duration, bar_format=shown, disable=None) as bar:
            for due, item in self._playback.timeline():
                now = time.monotonic()
                if began + due > now and stop.wait(began + due - now):
                    break
                if stop.requested:
                    break
                if isinstance(item, ClockTick):
                    self._publish_clock(item.log_time_ns)
                elif item.topic in self._publishers:
                    self._publishers[item.topic].publish(item.data)
                    self.published += 1
                if now - drawn > BAR_SECONDS:
                    bar.update(self._playback.bag_seconds(item) - bar.n)
                    drawn = now
            else:
                bar.update(bar.total - bar.n)

    def finish(self) -> None:
        """Give reliable subscribers a moment to confirm the last messages."""
        deadline = time.monotonic() + ACKNOWLEDGE_SECONDS
        for publisher in self._publishers.values():
            left = max(0.0, deadline - time.monotonic())
            publisher.wait_for_all_acked(Duration(nanoseconds=int(left * 1e9)))

    def _publish_clock(self, time_ns: int) -> None:
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(int(time_ns), 1_000_000_000)
        assert self._clock is not None
        self._clock.publish(message)


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """The command line, without ROS arguments."""
    parser = OneLineParser(
        prog="bicycle_play", description="Publish the messages of a bag again, as recorded."
    )
    add = parser.add_argument
    add("bag", type=Path, help="bag directory or .mcap file")
    add("-r", "--rate", type=float, default=1.0, help="bag seconds per second (%(default)s)")
    add("--start-offset", type=float, default=0.0, help="bag seconds to leave out (%(default)s)")
    add("-l", "--loop", action="store_true", help="begin again at the end, until Ctrl-C")
    add("--topics", nargs="+", default=[], help="play these (all)")
    add(
        "--clock",
        type=float,
        nargs="?",
        const=40.0,
        default=0.0,
        metavar="HZ",
        help="publish the time of recording on /clock so often per second (40 if none is given), "
        "in place of a recorded /clock",
    )
    add(
        "--delay",
        type=float,
        default=0.5,
        help="s before the first message, for subscribers to find the publishers (%(default)s)",
    )
    return parser.parse_args(arguments)


def play(options: argparse.Namespace, ros_arguments: Sequence[str]) -> str:
    """Replay a bag; returns the line that sums it up.

    Raises:
        BagError: The bag is broken or has nothing to play, or an option is wrong.
    """
    stop = Stop()
    chosen = PlayOptions(
        options.rate, options.start_offset, options.topics, options.clock, options.delay
    )
    reader = BagReader(options.bag)
    playback = Playback(reader, chosen)
    with ros_node("bicycle_player", ros_arguments) as node:
        player = Player(node, reader, playback, clock=chosen.clock_hz > 0.0)
        print(f"playing {options.bag}: {playback.duration:.1f} s; Ctrl-C ends it", flush=True)
        began = time.monotonic()
        ended = stop.wait(options.delay)
        while not ended:
            player.play(stop)
            ended = stop.requested or not options.loop
        player.finish()
    took = time.monotonic() - began
    return f"played {player.published} messages of {len(playback.topics)} topics in {took:.1f} s"


def main(arguments: Sequence[str] | None = None) -> int:
    """The command ``bicycle_play``; returns its exit status."""
    words = list(sys.argv if arguments is None else ["bicycle_play", *arguments])
    try:
        options = parse(without_ros(words))
        print(play(options, words), flush=True)
    except (BagError, UserError) as error:
        print(f"bicycle_play: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
