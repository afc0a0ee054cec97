"""Publishes a bag again: a stand-in for `ros2 bag play` where there is none."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_bag.nodes.player_node")

import argparse
import re
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from bicycle_bag.errors import BagError, OptionError
from bicycle_bag.nodes.controls import Controls
from bicycle_bag.nodes.player import Player
from bicycle_bag.nodes.session import ros_node
from bicycle_bag.playback import LONGEST_GAP, Playback, PlayOptions
from bicycle_bag.qos_overrides import read_overrides
from bicycle_bag.reader import BagReader
from bicycle_bag.selection import absolute, echo_of
from bicycle_bag.tempo import Tempo
from bicycle_bag.versions import TodaysReader
from bicycle_common.command_line import FAILED, RULES, USAGE_ERROR, OneLineParser
from bicycle_common.nodes.runner import UserError
from bicycle_common.signals import StopRequest
from bicycle_common.validation import one_line

NAME = re.compile(r"/?[A-Za-z_~][\w~]*(/[A-Za-z_][\w]*)*")


def parse(arguments: Sequence[str]) -> tuple[argparse.Namespace, list[str]]:
    """Return the parsed command line and its ROS arguments."""
    parser = OneLineParser(
        prog="replay.sh", description="Publish the messages of a bag again, as recorded."
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
        "--max-gap",
        type=float,
        default=LONGEST_GAP,
        metavar="S",
        help="bag seconds in which nothing was recorded that are waited for; a longer silence, or "
        "a clock that was set meanwhile, is told and left out (%(default)s)",
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
            raise OptionError(f"{rule!r} does not rename a topic: write /odom:=/ghost/odom")
        found[absolute(old)] = absolute(new)
    reader.require(list(found))
    for old, new in list(found.items()):  # the echo of a state goes with it
        echo = echo_of(old)
        if echo in reader.topics and echo not in found:
            found[echo] = echo_of(new) or f"{new}_command_echo"
    return found


def play(options: argparse.Namespace, ros_arguments: Sequence[str]) -> str:
    """Replay a bag; returns the line that sums it up.

    Raises:
        BagError: The bag is broken or has nothing to play, an option is wrong, or others publish
            the same topics.
    """
    stop = StopRequest().listen()
    chosen = PlayOptions(
        options.rate,
        options.start_offset,
        options.topics,
        options.clock,
        options.delay,
        options.exclude_topics,
        options.playback_duration,
        options.max_gap,
    )
    overrides = read_overrides(options.qos_profile_overrides_path)
    reader = TodaysReader(options.bag)
    playback = Playback(reader, chosen)
    names = renamed(options.remap, reader)
    for name in sorted(overrides.keys() - reader.topics.keys()):
        print(f"replay.sh: the bag has no {name}: its QoS profile is not used", file=sys.stderr)
    if reader.odd:
        print(f"replay.sh: {options.bag}/metadata.yaml: {reader.odd}", file=sys.stderr)
    tempo = Tempo(options.start_paused)
    with ros_node("bicycle_player", ros_arguments) as node:
        player = Player(node, reader, playback, tempo, chosen.clock_hz > 0.0, overrides, names)
        keyboard = not options.disable_keyboard_controls
        controls = Controls(node, tempo, keyboard, lambda line: tqdm.write(line, file=sys.stderr))
        guess = ", by guess, as the recording's clock jumps" if playback.clock_jumps else ""
        length = f"{playback.duration:.1f} s{guess}"
        print(f"playing {options.bag}: {length}; Ctrl-C ends it", flush=True)
        if options.start_paused:
            print("paused: the space bar or the service ~/resume goes on", flush=True)
        began = time.monotonic()
        with controls.reading():
            ended = player.serve(options.delay, stop, controls)
            while not ended:
                try:
                    player.play(stop, controls)
                except BagError as error:
                    played = f"{player.published} messages were played"
                    raise BagError(f"{error}; until then {played}{player.remarks}") from None
                ended = stop.requested or not options.loop
        player.finish()
        controls.close()
    took = time.monotonic() - began
    return (
        f"played {player.published} messages of {len(playback.topics)} topics in {took:.1f} s"
        f"{player.remarks}"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command `bicycle_play`, which `replay.sh` starts; return its exit status."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        options, ros_arguments = parse(words)
        print(one_line(play(options, ros_arguments)), flush=True)
    except (OptionError, UserError) as error:
        print(f"replay.sh: {error}", file=sys.stderr)
        return USAGE_ERROR
    except BagError as error:
        print(f"replay.sh: {error}", file=sys.stderr)
        return FAILED
    return 0
