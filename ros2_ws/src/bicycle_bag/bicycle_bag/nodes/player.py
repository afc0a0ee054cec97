"""Publishers for a bag's topics, and the loop that serves them in time."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from tqdm import tqdm

from bicycle_bag.errors import BagError
from bicycle_bag.metadata import Topic
from bicycle_bag.nodes.controls import Controls
from bicycle_bag.nodes.others import (
    drivers_of_states_alone,
    guarded,
    listed,
    other_publishers,
)
from bicycle_bag.nodes.session import message_class, overridden_profile, publisher_profile
from bicycle_bag.playback import ClockTick, Playback
from bicycle_bag.qos import QosProfile
from bicycle_bag.reader import BagMessage, BagReader
from bicycle_bag.tempo import SLICE, Tempo
from bicycle_common.signals import StopRequest
from bicycle_common.topic_names import CLOCK
from bicycle_common.validation import one_line

QUEUE = 1000
LATCHED = 10
ACKNOWLEDGE_SECONDS = 1.0
BAR_SECONDS = 0.1
MOST_TOLD = 10
"""Largest number of jumps of the recording's clock that are reported one by one."""
LATEST_CLOCK = 2**31 - 1
"""s since 1970, which ends in 2038."""
DISCOVERY_SECONDS = 1.0
"""Time to discover other publishers (s); nodes of this machine appear within 0.3 s."""
SETTLE_SECONDS = 0.3
"""Time to discover all other publishers of a node and of its companions (s)."""
LOOK_SECONDS = 0.5
"""Time between two looks for others that begin to publish the same topics (s)."""


class Player:
    """Publishes a bag once or again and again.

    Args:
        node: that publishes.
        reader: the bag.
        playback: what is played, and when.
        tempo: the clock that the replay goes by.
        clock: True to publish `/clock`.
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
        self.left_out: Counter[str] = Counter()
        self._told = 0
        self._node = node
        self._playback = playback
        self._types = {name: reader.topics[name].type for name in playback.topics}
        self._tempo = tempo
        self._names = {name: names.get(name, name) for name in playback.topics}
        kinds = self._playable(reader)
        played = [*(self._names[name] for name in kinds), *([CLOCK] if clock else [])]
        resolved = [node.resolve_topic_name(name) for name in played]
        _refuse_twins([*kinds, CLOCK], resolved)
        self._guarded = [*guarded(resolved), *drivers_of_states_alone(resolved)]
        self._looked = time.monotonic()
        self._look_around(own=0, patience=DISCOVERY_SECONDS)
        self._publishers: dict[str, Publisher] = {}
        for name, kind in kinds.items():
            profile = _profile(reader.topics[name].qos, overrides.get(name))
            self._publishers[name] = _publisher(node, kind, self._names[name], profile)
        self._clock = node.create_publisher(Clock, CLOCK, LATCHED) if clock else None

    def _playable(self, reader: BagReader) -> dict[str, type[Any]]:
        """Return the classes of the topics that can be played; warn of the others.

        Raises:
            BagError: There is none.
        """
        kinds = {}
        for name in self._playback.topics:
            try:
                kinds[name] = self._class_of(reader.topics[name])
            except BagError as error:
                self._node.get_logger().warning(f"{name} is not played: {error}")
        if not kinds:
            raise BagError("no topic can be played, for the reasons above")
        return kinds

    def _class_of(self, topic: Topic) -> type[Any]:
        """Return the class of a topic's messages.

        Raises:
            BagError: It cannot be played.
        """
        if topic.serialization_format != "cdr":
            raise BagError(f"its messages are {topic.serialization_format or 'unknown'}, not cdr")
        try:
            self._node.resolve_topic_name(self._names[topic.name])
        except Exception as error:  # rcl's, on a name that it does not take
            reason = " ".join(str(error).split())[:200]
            raise BagError(f"rename it with --remap ({reason})") from None
        return message_class(topic.type)

    def play(self, stop: StopRequest, controls: Controls) -> None:
        """Publish everything once, each message when it is due; ends early on a signal.

        Raises:
            BagError: Another node begins to publish what is played, or the bag is corrupt where it
                is being read.
        """

        def rest(seconds: float) -> bool:
            controls.serve()
            self.watch()
            return stop.wait(seconds)

        self._tempo.restart()
        drawn = served = time.monotonic()
        shown = "{l_bar}{bar}| {n:.1f}/{total:.1f} s of the bag [{elapsed}<{remaining}]"
        with tqdm(total=self._playback.duration, bar_format=shown, disable=None) as bar:
            for due, item in self._playback.timeline(self._tell):
                if not self._tempo.wait_until(due, rest) or stop.requested:
                    break
                now = time.monotonic()
                if now - served > SLICE:  # where one message is due after the other
                    rest(0.0)
                    served = now
                if isinstance(item, ClockTick):
                    self._publish_clock(item.log_time_ns)
                else:
                    self._publish(item)
                if now - drawn > BAR_SECONDS:
                    played = min(due * self._playback.rate, bar.total)
                    bar.update(max(0.0, played - bar.n))
                    drawn = now
            else:
                bar.update(bar.total - bar.n)

    def _tell(self, line: str) -> None:
        """Print each jump of the recording's clock; after a few, only count them."""
        self._told += 1
        if self._told <= MOST_TOLD:
            tqdm.write(one_line(line), file=sys.stdout)
            sys.stdout.flush()

    @property
    def remarks(self) -> str:
        """Return what was not played and how often the clock jumped; empty if all was well."""
        parts = []
        if self.left_out:
            topics = ", ".join(sorted(self.left_out))
            parts.append(f"{sum(self.left_out.values())} messages were not played, of {topics}")
        if self._told > MOST_TOLD:
            parts.append(f"the recording's clock jumped {self._told} times")
        return "".join(f"; {part}" for part in parts)

    def _publish(self, item: BagMessage) -> None:
        """Publish a message, or count it where that cannot be."""
        publisher = self._publishers.get(item.topic)
        if publisher is None or item.encoding != "cdr" or item.type != self._types[item.topic]:
            self.left_out[item.topic] += 1
            return
        try:
            publisher.publish(item.data)
        except Exception as error:  # the middleware's, on bytes that are no message
            if not self.left_out[item.topic]:
                reason = " ".join(str(error).split())[:200]
                self._node.get_logger().warning(f"a message of {item.topic}: {reason}")
            self.left_out[item.topic] += 1
            return
        self.published += 1

    def watch(self) -> None:
        """Look for others now and then.

        Raises:
            BagError: Another node publishes what is played.
        """
        now = time.monotonic()
        if now - self._looked > LOOK_SECONDS:
            self._looked = now
            self._look_around(own=1)

    def serve(self, seconds: float, stop: StopRequest, controls: Controls) -> bool:
        """Wait while services, keys and others are attended to; whether to end.

        Raises:
            BagError: Another node publishes what is played.
        """
        deadline = time.monotonic() + seconds
        while True:
            controls.serve()
            self.watch()
            left = deadline - time.monotonic()
            if stop.wait(max(0.0, min(SLICE, left))) or left <= 0.0:
                return stop.requested

    def _look_around(self, own: int, patience: float = 0.0) -> None:
        """Look for others, so long as some may not have been seen yet.

        Raises:
            BagError: Another node publishes what is played.
        """
        deadline = time.monotonic() + patience
        while not (found := self._others(own)):
            if time.monotonic() >= deadline:
                return
            time.sleep(SLICE)
        raise BagError(
            f"the same topics are published by {listed(found)}: end that (stop.sh), play on "
            "another ROS_DOMAIN_ID, leave topics out with --exclude-topics, or rename them with "
            "--remap"
        )

    def _others(self, own: int) -> dict[str, list[str]]:
        """Return the others and their topics; nobody if those who were seen end meanwhile."""
        if not other_publishers(self._node, self._guarded, own):
            return {}
        time.sleep(SETTLE_SECONDS)
        return other_publishers(self._node, self._guarded, own)

    def finish(self) -> None:
        """Give reliable subscribers a moment to confirm the last messages."""
        deadline = time.monotonic() + ACKNOWLEDGE_SECONDS
        for publisher in self._publishers.values():
            left = max(0.0, deadline - time.monotonic())
            publisher.wait_for_all_acked(Duration(nanoseconds=int(left * 1e9)))

    def _publish_clock(self, time_ns: int) -> None:
        seconds, rest = divmod(time_ns, 1_000_000_000)
        if seconds > LATEST_CLOCK:  # a stamp holds no more
            self.left_out[CLOCK] += 1
            return
        message = Clock()
        message.clock.sec, message.clock.nanosec = seconds, rest
        assert self._clock is not None
        self._clock.publish(message)


def _refuse_twins(topics: Sequence[str], names: Sequence[str]) -> None:
    """Refuse two topics under one name, which nobody can tell apart.

    Args:
        topics: names in the bag, and perhaps one more.
        names: under which they are published.

    Raises:
        BagError: There are two.
    """
    first: dict[str, str] = {}
    for topic, name in zip(topics, names, strict=False):
        if name in first:
            raise BagError(
                f"{first[name]} and {topic} would both be {name}: give them different names with "
                "--remap, or leave one out with --exclude-topics"
            )
        first[name] = topic


def _publisher(node: Node, kind: type[Any], name: str, profile: QoSProfile) -> Publisher:
    """Return a publisher.

    Raises:
        BagError: The middleware refuses it.
    """
    try:
        return node.create_publisher(kind, name, profile)
    except Exception as error:  # rcl's, on what the middleware cannot do
        reason = " ".join(str(error).split())[:200]
        raise BagError(f"{name} cannot be published ({reason}): leave it out") from None


def _profile(recorded: Sequence[QosProfile], override: QosProfile | None) -> QoSProfile:
    """Return the profile with which to publish a topic."""
    if override is not None:
        return overridden_profile(override, QUEUE)
    return publisher_profile(recorded, QUEUE, LATCHED)
