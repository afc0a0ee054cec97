"""`topic.sh pub`: messages from the command line, as `ros2 topic pub` sends them."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any, Protocol

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from bicycle_common.nodes.runner import resolved_topic
from bicycle_common.signals import StopRequest
from bicycle_tools.nodes.filling import FillingError, filled

MATCH = 3.0
"""Time to wait for subscribers (s)."""
ACKNOWLEDGE = 1.0
"""Time for reliable subscribers to confirm the last message (s)."""
FASTEST = 10_000.0
"""Highest rate, Hz."""


class Graph(Protocol):
    """Interface of the node that inspects the graph."""

    node: Node
    stop: StopRequest

    def spin(self, seconds: float, until: Callable[[], bool] = ...) -> bool:
        """Spin for some time, or until a condition holds."""

    def topics(self) -> dict[str, str]:
        """Return the names of all topics and their types."""

    def message_type(self, full: str, kind: str) -> type[Any]:
        """Return the class of a type."""


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Declare the arguments of `topic.sh pub`."""
    add = verb.add_argument
    add("topic")
    add("type", nargs="?", default="")
    add("values", nargs="?", default="")
    add("-1", "--once", action="store_true")
    add("-t", "--times", type=int, default=0)
    add("-r", "--rate", type=float, default=1.0)
    add("-w", "--wait-matching-subscriptions", type=int, default=None)
    add("--qos-reliability", choices=("reliable", "best_effort"), default="reliable")
    add("--qos-durability", choices=("volatile", "transient_local"), default="volatile")


def mistake(given: argparse.Namespace) -> str:
    """Return the error in the options, in one line; empty if there is none."""
    if not 0.0 < given.rate <= FASTEST:
        return f"--rate is {given.rate}: choose up to {FASTEST:g} Hz"
    if given.times < 0 or (given.wait_matching_subscriptions or 0) < 0:
        return "--times and --wait-matching-subscriptions take whole numbers from 0 on"
    return ""


def publish(graph: Graph, given: argparse.Namespace) -> int:
    """Publish messages until all are sent, or until Ctrl-C; return the exit status.

    Raises:
        FillingError: if the type is unknown, or the values do not fit.
        LookupError: if the awaited subscribers are missing.
        UserError: if ROS allows no such name of a topic.
    """
    kind, values = given.type, given.values
    if kind and "/msg/" not in kind:
        if values:
            raise FillingError(f"{kind!r} is no type of a message: write pkg/msg/Type")
        kind, values = "", kind
    full = resolved_topic(graph.node, given.topic)
    graph.spin(MATCH, lambda: bool(kind) or full in graph.topics())
    known = graph.topics().get(full, "")
    if not (kind or known):
        raise FillingError(f"nobody knows {full} yet, so its type is needed: write pkg/msg/Type")
    message = filled(graph.message_type(full, kind or known), values)
    profile = QoSProfile(
        depth=100,
        reliability=ReliabilityPolicy[given.qos_reliability.upper()],
        durability=DurabilityPolicy[given.qos_durability.upper()],
    )
    publisher = graph.node.create_publisher(type(message), full, profile)
    count = 1 if given.once else given.times
    wanted = given.wait_matching_subscriptions
    wanted = int(count > 0) if wanted is None else wanted
    if not graph.spin(MATCH, lambda: publisher.get_subscription_count() >= wanted):
        raise LookupError(
            f"{publisher.get_subscription_count()} subscribe to {full} after {MATCH:g} s, not "
            f"{wanted}: choose another -w, 0 sends all the same"
        )
    sent = _send(graph, publisher, message, count, 1.0 / given.rate)
    publisher.wait_for_all_acked(Duration(nanoseconds=int(ACKNOWLEDGE * 1e9)))
    print(f"published {sent} {'message' if sent == 1 else 'messages'} on {full}", flush=True)
    return 0


def _send(graph: Graph, publisher: Any, message: Any, count: int, period: float) -> int:
    """Publish `count` times, or without end for 0; return the number of messages."""
    due, sent = time.monotonic(), 0
    while not graph.stop.requested and not 0 < count <= sent:
        publisher.publish(message)
        sent += 1
        due += period
        if sent != count:
            graph.spin(max(0.0, due - time.monotonic()))
    return sent
