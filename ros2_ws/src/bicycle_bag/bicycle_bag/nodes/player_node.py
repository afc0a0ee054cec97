"""Publishes a bag again: a stand-in for ``ros2 bag play`` where there is none."""

from __future__ import annotations

import argparse
import re
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from tqdm import tqdm

from bicycle_bag.arguments import RULES, OneLineParser
from bicycle_bag.errors import BagError
from bicycle_bag.nodes.controls import Controls
from bicycle_bag.nodes.others import guarded, other_publishers, told
from bicycle_bag.nodes.session import (
    Stop,
    message_class,
    overridden_profile,
    publisher_profile,
    ros_node,
)
from bicycle_bag.playback import CLOCK, ClockTick, Playback, PlayOptions
from bicycle_bag.qos import QosProfile
from bicycle_bag.qos_overrides import read_overrides
from bicycle_bag.reader import BagReader
from bicycle_bag.selection import absolute
from bicycle_bag.tempo import SLICE, Tempo
from bicycle_sim.nodes.runner import UserError

QUEUE = 1000
LATCHED = 10
ACKNOWLEDGE_SECONDS = 1.0
BAR_SECONDS = 0.1
DISCOVERY_SECONDS = 1.0
"""For other publishers to be seen; nodes of this machine announce themselves within 0.3 s."""
SETTLE_SECONDS = 0.3
"""For all that another node publishes, and for its companions, to be seen."""
LOOK_SECONDS = 0.5
"""Between two looks for others that begin to publish the same topics."""
NAME = re.compile(r"/?[A-Za-z_~][\w~]*(/[A-Za-z_][\w]*)*")


class Player:
    """Publishers for a bag's topics, and the loop that serves them in time.

    Args:
        node: that publishes.
        reader: the bag.
        playback: what is played, and when.
        tempo: the clock that the replay goes by.
        clock: whether to publish `/clock`.
        overrides: profiles to publish with, by the topics' names in the bag.
        names: names to publish topics under, by their names in the bag.
    """

    def __init__(
        self,
        node: Node,
        reader: BagReader,
        playback: Playback,
        tempo: Tempo,
        clock: bool,
        overrides: Mapping[str, QosProfile],
        names: Mapping[str, str],
    ) -> None:
        self.published = 0
        self._node = node
        self._playback = playback
        self._tempo = tempo
        self._names = {name: names.get(name, name) for name in playback.topics}
        played = [*self._names.values(), *([CLOCK] if clock else [])]
        self._guarded = guarded(map(node.resolve_topic_name, played))
        self._publishers: dict[str, Publisher] = {}
        self._looked = time.monotonic()
        self._look_around(own=0, patience=DISCOVERY_SECONDS)
        for name in playback.topics:
            topic = reader.topics[name]
            try:
                kind = message_class(topic.type)
            except BagError as error:
                node.get_logger().warning(f"{name} is not played: {error}")
                continue
            profile = _profile(topic.qos, overrides.get(name))
            self._publishers[name] = node.create_publisher(kind, self._names[name], profile)
        if not self._publishers:
            raise BagError("no topic can be played: source the workspace that has their types")
        self._clock = node.create_publisher(Clock, CLOCK, LATCHED) if clock else None

    def play(self, stop: Stop, controls: Controls) -> None:
        """Publish everything once, each message when it is due; ends early on a signal.

        Raises:
            BagError: Another node begins to publish what is played.
        """

        def rest(seconds: float) -> bool:
            controls.serve()
            self.watch()
            return stop.wait(seconds)

        self._tempo.restart()
        drawn = served = time.monotonic()
        shown = "{l_bar}{bar}| {n:.1f}/{total:.1f} s of the bag [{elapsed}<{remaining}]"
        with tqdm(total=self._playback.duration, bar_format=shown, disable=None) as bar:
            for due, item in self._playback.timeline():
                if not self._tempo.wait_until(due, rest) or stop.requested:
                    break
                now = time.monotonic()
                if now - served > SLICE:  # where one message is due after the other
                    rest(0.0)
                    served = now
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

    def watch(self) -> None:
        """Look for others now and then.

        Raises:
            BagError: Another node publishes what is played.
        """
        now = time.monotonic()
        if now - self._looked > LOOK_SECONDS:
            self._looked = now
            self._look_around(own=1)

    def _look_around(self, own: int, patience: float = 0.0) -> None:
        """Look for others, so long as some may not have been seen yet.

        Raises:
            BagError: Another node publishes what is played.
        """
        deadline = time.monotonic() + patience
        while not other_publishers(self._node, self._guarded, own):
            if time.monotonic() >= deadline:
                return
            time.sleep(SLICE)
        time.sleep(SETTLE_SECONDS)
        found = other_publishers(self._node, self._guarded, own)
        raise BagError(
            f"the same topics are published by {told(found)}: end that (stop.sh), play on another "
            "ROS_DOMAIN_ID, leave topics out with --exclude-topics, or rename them with --remap"
        )

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


def _profile(recorded: Sequence[QosProfile], override: QosProfile | None) -> QoSProfile:
    """What to publish a topic with."""
    if override is not None:
        return overridden_profile(override, QUEUE)
    return publisher_profile(recorded, QUEUE, LATCHED)


def parse(arguments: Sequence[str]) -> tuple[argparse.Namespace, list[str]]:
    """The command line, and what of it is ROS's."""
    parser = OneLineParser(
        prog="bicycle_play", description="Publish the messages of a bag again, as recorded."
    )
    add = parser.add_argument
    add("bag", type=Path, help="bag directory or .mcap file")
    add("-r", "--rate", type=float, default=1.0, help="bag seconds per second (%(default)s)")
    add("--start-offset", type=float, default=0.0, help="bag seconds to leave out (%(default)s)")
    add("--playback-duration", type=float, default=0.0, help="bag seconds to play (to the end)")
    add("-l", "--loop", action="store_true", help="begin again at the end, until Ctrl-C")
    add(
        "-p",
        "--start-paused",
        "--pause",
        action="store_true",
        help="wait for the space bar or the service ~/resume",
    )
    add("--topics", nargs="+", default=[], help="play these (all)")
    add("--exclude-topics", nargs="+", default=[], help="leave out these")
    add(
        "-m",
        "--remap",
        nargs="+",
        default=[],
        metavar=RULES,
        help="play topics under other names, as /odom:=/ghost/odom",
    )
    add("--qos-profile-overrides-path", default="", metavar="FILE", help="YAML, as ros2 bag's")
    add("--disable-keyboard-controls", action="store_true", help="read no keys")
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
        "-d",
        type=float,
        default=0.5,
        help="s before the first message, for subscribers to find the publishers (%(default)s)",
    )
    return parser.parse_with_ros(arguments)


def renamed(rules: Sequence[str], reader: BagReader) -> dict[str, str]:
    """New names of topics by their old ones.

    Raises:
        BagError: A rule is none, or the bag has no such topic.
    """
    found = {}
    for rule in rules:
        old, mark, new = rule.partition(":=")
        if not (mark and NAME.fullmatch(old) and NAME.fullmatch(new)):
            raise BagError(f"{rule!r} does not rename a topic: write /odom:=/ghost/odom")
        found[absolute(old)] = absolute(new)
    reader.require(list(found))
    return found


def play(options: argparse.Namespace, ros_arguments: Sequence[str]) -> str:
    """Replay a bag; returns the line that sums it up.

    Raises:
        BagError: The bag is broken or has nothing to play, an option is wrong, or others publish
            the same topics.
    """
    stop = Stop()
    chosen = PlayOptions(
        options.rate,
        options.start_offset,
        options.topics,
        options.clock,
        options.delay,
        options.exclude_topics,
        options.playback_duration,
    )
    overrides = read_overrides(options.qos_profile_overrides_path)
    reader = BagReader(options.bag)
    playback = Playback(reader, chosen)
    names = renamed(options.remap, reader)
    tempo = Tempo(options.start_paused)
    with ros_node("bicycle_player", ros_arguments) as node:
        player = Player(node, reader, playback, tempo, chosen.clock_hz > 0.0, overrides, names)
        keyboard = not options.disable_keyboard_controls
        controls = Controls(node, tempo, keyboard, lambda line: tqdm.write(line, file=sys.stderr))
        print(f"playing {options.bag}: {playback.duration:.1f} s; Ctrl-C ends it", flush=True)
        if options.start_paused:
            print("paused: the space bar or the service ~/resume goes on", flush=True)
        began = time.monotonic()
        with controls.reading():
            ended = stop.wait(options.delay)
            while not ended:
                player.play(stop, controls)
                ended = stop.requested or not options.loop
        player.finish()
        controls.close()
    took = time.monotonic() - began
    return f"played {player.published} messages of {len(playback.topics)} topics in {took:.1f} s"


def main(arguments: Sequence[str] | None = None) -> int:
    """The command ``bicycle_play``; returns its exit status."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        options, ros_arguments = parse(words)
        print(play(options, ros_arguments), flush=True)
    except (BagError, UserError) as error:
        print(f"bicycle_play: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
