"""`topic.sh`: inspect any topic and publish on it, for installations without `ros2`."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_tools.nodes.topic")

import argparse
import sys
import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from bicycle_common.command_line import OneLineParser
from bicycle_common.nodes.runner import UserError, resolved_topic, start_tool
from bicycle_common.signals import StopRequest
from bicycle_common.validation import nearest
from bicycle_tools.nodes import publishing
from bicycle_tools.nodes.filling import FillingError
from bicycle_tools.nodes.flatten import flatten, shown
from bicycle_tools.nodes.message_types import message_class
from bicycle_tools.rates import Rate
from bicycle_tools.settled import Settled

DISCOVERY = 1.0
"""Time without a new topic or node after which no more are expected (s); nodes of this machine
announce themselves within 0.3 s, one after another if it is busy."""
LONGEST_WAIT = 5.0
"""Longest wait for all topics, for an unpublished one, and for its first message (s)."""


class TopicError(Exception):
    """Why something cannot be shown; its text is one line with the remedy."""


class Watcher:
    """Node that inspects the graph and messages of any type."""

    def __init__(self) -> None:
        self.stop = StopRequest().listen()
        # A hidden node, without parameters or rosout.
        self.node: Node = rclpy.create_node(
            "_bicycle_topic", start_parameter_services=False, enable_rosout=False
        )
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()

    def spin(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Spin for some time, or until a condition holds; return True if it held."""
        deadline = time.monotonic() + seconds
        while not (until() or self.stop.requested) and time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=min(0.05, seconds))
        return until()

    def topics(self) -> dict[str, str]:
        """Return the names of all topics and their types."""
        found = self.node.get_topic_names_and_types()
        return {name: ", ".join(types) for name, types in sorted(found)}

    def find(self, name: str, published: bool = True) -> tuple[str, str]:
        """Return the full name and the type of a topic.

        Args:
            name: the topic's name.
            published: True to require a publisher; otherwise a subscriber suffices.

        Raises:
            TopicError: if there is none.
            UserError: if ROS allows no such name.
        """
        full = resolved_topic(self.node, name)

        def there() -> bool:
            return bool(self.node.count_publishers(full) if published else full in self.topics())

        if not self.spin(LONGEST_WAIT, there):
            known = self.topics()
            hint = nearest(full, [topic for topic in known if topic != full])
            what = "nobody publishes" if published else "there is no topic"
            raise TopicError(f"{what} {full}{hint}: see topic.sh list")
        return full, self.topics()[full]

    def message_type(self, full: str, kind: str) -> type[Any]:
        """Return the class of a topic's type.

        Raises:
            TopicError: if it is not installed, or there are several.
        """
        try:
            return message_class(kind)
        except LookupError as error:
            raise TopicError(f"{full} {error}") from None

    def subscribe(self, name: str, callback: Callable[[Any], None], raw: bool = False) -> None:
        """Subscribe to a topic with its publishers' quality of service.

        Raises:
            TopicError: if its type is not installed.
        """
        full, kind = self.find(name)
        message_type = self.message_type(full, kind)
        offers = [p.qos_profile for p in self.node.get_publishers_info_by_topic(full)]
        profile = QoSProfile(depth=100)
        if any(offer.reliability is not ReliabilityPolicy.RELIABLE for offer in offers):
            profile.reliability = ReliabilityPolicy.BEST_EFFORT
        if all(offer.durability is DurabilityPolicy.TRANSIENT_LOCAL for offer in offers):
            profile.durability = DurabilityPolicy.TRANSIENT_LOCAL
        self.node.create_subscription(message_type, full, callback, profile, raw=raw)


def show_list(watcher: Watcher, _: argparse.Namespace) -> int:
    """Print all topics with their types and numbers of publishers and subscribers."""

    def found() -> list[tuple[str, str, int, int]]:
        node = watcher.node
        return [
            (name, kind, node.count_publishers(name), node.count_subscribers(name))
            for name, kind in watcher.topics().items()
        ]

    watcher.spin(LONGEST_WAIT, Settled(found, DISCOVERY))
    topics = found()
    width = max((len(name) for name, *_ in topics), default=0)
    for name, kind, publish, subscribe in topics:
        print(f"{name:<{width}}  {kind}  ({publish} publish, {subscribe} subscribe)")
    return 0


def show_info(watcher: Watcher, given: argparse.Namespace) -> int:
    """Print publishers and subscribers with their quality of service."""
    full, kind = watcher.find(given.topic, published=False)
    publishers = partial(watcher.node.get_publishers_info_by_topic, full)
    subscribers = partial(watcher.node.get_subscriptions_info_by_topic, full)

    def names() -> list[str]:
        return [str(end.node_name) for end in (*publishers(), *subscribers())]

    watcher.spin(LONGEST_WAIT, Settled(names, DISCOVERY))
    print(f"{full}  {kind}")
    _print_ends("published by", publishers())
    _print_ends("subscribed by", subscribers())
    return 0


def show_type(watcher: Watcher, given: argparse.Namespace) -> int:
    """Print the type of a topic and the fields of its messages."""
    full, kind = watcher.find(given.topic, published=False)
    print(kind)
    for field, type_name in watcher.message_type(full, kind).get_fields_and_field_types().items():
        print(f"  {field}: {type_name}")
    return 0


def _print_ends(title: str, ends: Iterable[Any]) -> None:
    for end in ends:
        profile = end.qos_profile
        quality = f"{profile.reliability.name.lower()}, {profile.durability.name.lower()}"
        space = end.node_namespace.rstrip("/")
        print(f"  {title} {space}/{end.node_name} ({quality})")


def echo(watcher: Watcher, given: argparse.Namespace) -> int:
    """Print messages as dotted names and values, until Ctrl-C or after one."""
    seen = 0

    def on_message(message: Any) -> None:
        nonlocal seen
        if given.once and seen:
            return
        lines = [
            f"{name}: {shown(value)}"
            for name, value in flatten(message)
            if not given.field
            or name == given.field
            or name.startswith((f"{given.field}.", f"{given.field}["))
        ]
        if not lines:
            raise TopicError(f"{given.topic} has no field {given.field!r}: see it without --field")
        print("\n".join([*lines, "---"]), flush=True)
        seen += 1

    watcher.subscribe(given.topic, on_message)
    if not watcher.spin(LONGEST_WAIT, lambda: seen > 0) and not watcher.stop.requested:
        raise TopicError(f"no message of {given.topic} within {LONGEST_WAIT:g} s")
    while not (given.once or watcher.stop.requested):
        watcher.spin(1.0)
    return 0


def show_rate(watcher: Watcher, given: argparse.Namespace) -> int:
    """Print the rate of messages and its regularity, once a second."""
    rate = Rate()
    watcher.subscribe(given.topic, lambda data: rate.add(time.monotonic(), len(data)), raw=True)
    began = time.monotonic()
    while not watcher.stop.requested and not 0 < given.seconds <= time.monotonic() - began:
        watcher.spin(min(1.0, given.seconds or 1.0))
        print(rate, flush=True)
    return 0 if rate.count else 1


def publish(watcher: Watcher, given: argparse.Namespace) -> int:
    """Publish the messages of the command line."""
    try:
        return publishing.publish(watcher, given)
    except FillingError as error:
        print(f"topic.sh: {error}", file=sys.stderr)
        return 2
    except LookupError as error:
        raise TopicError(str(error)) from None


def parse(arguments: list[str]) -> tuple[argparse.Namespace, list[str]]:
    """Read the command line; on an error end the program with status 2 and one line."""
    parser = OneLineParser(prog="topic.sh")
    names = "list|info|type|echo|rate|hz|pub"
    verbs = parser.add_subparsers(dest="verb", required=True, metavar=names)
    verbs.add_parser("list").set_defaults(action=show_list)
    sent = verbs.add_parser("pub")
    publishing.add_arguments(sent)
    sent.set_defaults(action=publish)
    actions = {"info": show_info, "type": show_type, "echo": echo}
    for name, action in {**actions, "rate": show_rate, "hz": show_rate}.items():
        verb = verbs.add_parser(name)
        verb.add_argument("topic")
        verb.set_defaults(action=action)
        if name == "echo":
            verb.add_argument("--once", action="store_true")
            verb.add_argument("--field", default="")
        if action is show_rate:
            verb.add_argument("--seconds", type=float, default=0.0)
    given, ros = parser.parse_with_ros(arguments)
    if given.verb in ("rate", "hz") and not 0 <= given.seconds < 1e6:
        parser.error(f"--seconds is {given.seconds}: choose a positive number")
    if given.verb == "pub" and (wrong := publishing.mistake(given)):
        parser.error(wrong)
    return given, ros


def main() -> int:
    """Run the command line; return the exit status."""
    given, ros = parse(sys.argv[1:])
    start_tool("topic.sh", ros)
    watcher = Watcher()
    try:
        status: int = given.action(watcher, given)
        return status
    except TopicError as error:
        print(f"topic.sh: {error}", file=sys.stderr)
        return 1
    except UserError as error:
        print(f"topic.sh: {error}", file=sys.stderr)
        return 2
    finally:
        watcher.close()
        rclpy.try_shutdown()
