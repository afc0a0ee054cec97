"""`foxglove.sh`: Foxglove's WebSocket server on the topics of the bicycle, without a bridge.

Topics are sent unchanged: CDR with their `ros2msg` definitions. Messages of clients are accepted
as a goal or a pose, checked, and published again. The server calls back from its own threads, so
each call is queued, and the node's only thread processes the queue.
"""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_tools.nodes.foxglove_server")

import functools
import queue
import sys
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import foxglove
from foxglove.websocket import (
    Capability,
    ChannelView,
    Client,
    ClientChannel,
    ServerListener,
    WebSocketServer,
)
from geometry_msgs.msg import Point, PoseStamped, PoseWithCovarianceStamped, Quaternion
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from bicycle_bag.errors import BagError
from bicycle_bag.schemas import Schemas
from bicycle_bag.selection import TopicFilter
from bicycle_common.nodes import convert, topics
from bicycle_common.nodes.declare_parameters import declare
from bicycle_common.nodes.runner import UserError, run
from bicycle_common.parameters import describe
from bicycle_tools.foxglove_pose import MOST_BYTES, parse_pose
from bicycle_tools.foxglove_settings import FoxgloveSettings
from bicycle_tools.nodes.foxglove_meshes import mesh
from bicycle_tools.nodes.foxglove_relay import Relay
from bicycle_tools.nodes.foxglove_services import Services

NAME = "bicycle_foxglove"
DISCOVERY = 0.5
"""Period of the search for new topics (s)."""
MOST_WAITING = 1000
"""Largest number of queued calls of the server; beyond it, clients' messages are dropped."""
ACCEPTED = (topics.GOAL_POSE, topics.INITIAL_POSE)
"""Topics that clients may publish."""
HEARING = 3.0
"""Time that a client's message waits for a subscriber (s)."""
QUIET = 1.0
MOST_COMPLAINTS = 20
"""Lines about refused messages per QUIET seconds, so that bad messages cannot flood the log."""


class Listener(ServerListener):
    """Puts each of the server's calls into the node's queue."""

    def __init__(self, put: Callable[[Callable[[], None]], None], node: FoxgloveServer) -> None:
        self._put, self._node = put, node

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Handle a client's subscription to a topic."""
        self._put(functools.partial(self._node.on_watch, channel.id, True))

    def on_unsubscribe(self, client: Client, channel: ChannelView) -> None:
        """Handle the end of a client's subscription."""
        self._put(functools.partial(self._node.on_watch, channel.id, False))

    def on_client_advertise(self, client: Client, channel: ClientChannel) -> None:
        """Handle a client's offer to publish."""
        facts = (channel.topic, channel.encoding, channel.schema_name)
        self._put(functools.partial(self._node.on_offer, (client.id, channel.id), facts))

    def on_client_unadvertise(self, client: Client, client_channel_id: int) -> None:
        """Handle the end of a client's offer."""
        self._put(functools.partial(self._node.on_withdraw, (client.id, client_channel_id)))

    def on_message_data(self, client: Client, client_channel_id: int, data: bytes) -> None:
        """Handle a client's message."""
        key = (client.id, client_channel_id)
        self._put(functools.partial(self._node.on_data, key, bytes(data)))


class FoxgloveServer(Node):
    """Relays the bicycle's topics to Foxglove, and Foxglove's goals to the bicycle."""

    def __init__(self) -> None:
        super().__init__(NAME)
        self._settings = declare(self, FoxgloveSettings)
        self._calls: queue.Queue[Callable[[], None]] = queue.Queue(MOST_WAITING)
        self._wake = self.create_guard_condition(self._work)
        self._schemas = Schemas()
        self._relays: dict[str, Relay] = {}
        self._refused: set[str] = set()
        self._offers: dict[tuple[int, int], tuple[str, str, str]] = {}
        self._held: dict[str, tuple[Any, float]] = {}
        self._complaints: deque[float] = deque(maxlen=MOST_COMPLAINTS)
        publishers = topics.advertise(self, *ACCEPTED) if self._settings.publish else {}
        self._inputs = {given.topic_name: (given, given.msg_type) for given in publishers.values()}
        try:
            self._filter = TopicFilter(regex=self._settings.topics)
        except BagError as error:
            raise UserError(str(error)) from None
        self._shown = foxglove.Context()
        self._server = self._start()
        self.create_timer(DISCOVERY, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _start(self) -> WebSocketServer:
        settings = self._settings
        services = Services(self, self._put).offers if settings.publish else []
        given = [Capability.ClientPublish, Capability.Services] if settings.publish else []
        try:
            server = foxglove.start_server(
                name="self-driving bicycle",
                host=settings.host,
                port=settings.port,
                capabilities=given,
                services=services,
                supported_encodings=["json", "cdr"] if settings.publish else None,
                server_listener=Listener(self._put, self),
                asset_handler=mesh,
                context=self._shown,
                message_backlog_size=settings.backlog,
            )
        except Exception as error:  # the library's exceptions have no public base class
            reason = " ".join(str(error).split())
            raise UserError(
                f"cannot listen on {settings.host}:{settings.port} ({reason}): choose host:= "
                "and port:="
            ) from None
        address = f"ws://{settings.host}:{server.port}"
        self.get_logger().info(f"open Foxglove's connection 'Foxglove WebSocket' to {address}")
        if settings.is_open:
            self.get_logger().warning(
                f"{settings.host} is not loopback: whoever reaches this port sees all topics"
                + (" and sends goals" if settings.publish else "")
            )
        if settings.publish:
            self.get_logger().warning(
                "clients may send goals and call services: so may any web page open here"
            )
        else:
            self.get_logger().info("it only shows; publish:=true takes goals, poses and services")
        return server

    def _put(self, call: Callable[[], None]) -> None:
        """Queue a call from a thread of the server."""
        try:
            self._calls.put_nowait(call)
            self._wake.trigger()
        except queue.Full:
            pass  # a flood; the queue already holds more than a user can intend

    def _work(self) -> None:
        """Run the queued calls."""
        for _ in range(self._calls.qsize()):
            self._calls.get_nowait()()

    def _look(self) -> None:
        """Offer new topics, and subscribe to new publishers."""
        for name, kinds in self.get_topic_names_and_types():
            if name in self._relays:
                self._relays[name].look()
            elif name not in self._refused and self._is_wanted(name):
                self._add(name, kinds)
        self._pass_on()
        self._work()

    def _is_wanted(self, name: str) -> bool:
        """Return True if a topic is chosen, and somebody besides this node publishes it."""
        own = int(name in self._inputs)
        return self._filter.accepts(name) and self.count_publishers(name) > own

    def _add(self, name: str, kinds: list[str]) -> None:
        try:
            if len(kinds) > 1:
                raise BagError(f"it has several types ({', '.join(kinds)})")
            self._relays[name] = Relay(self, name, kinds[0], self._shown, self._schemas)
        except BagError as error:
            self._refused.add(name)
            self.get_logger().warning(f"{name} is not shown: {error}")

    def on_watch(self, channel_id: int, watches: bool) -> None:
        """Handle the start or end of a client's subscription to a channel."""
        for relay in self._relays.values():
            if relay.channel_id == channel_id:
                relay.watch() if watches else relay.unwatch()

    def on_offer(self, key: tuple[int, int], facts: tuple[str, str, str]) -> None:
        """Handle a client's offer to publish: topic, encoding and type."""
        topic, encoding, kind = facts
        wanted = self._inputs.get(topic)
        if wanted is None:
            takes = " and ".join(sorted(self._inputs))
            self._complain(f"{topic} is not taken from clients: publish on {takes}")
        elif kind.replace("/msg/", "/") != f"geometry_msgs/{wanted[1].__name__}":
            self._complain(f"{topic} takes geometry_msgs/{wanted[1].__name__}, not {kind}")
        elif encoding not in ("json", "cdr"):
            self._complain(f"{topic} takes json or cdr, not {encoding}")
        else:
            self._offers[key] = facts

    def on_withdraw(self, key: tuple[int, int]) -> None:
        """Handle the end of a client's offer to publish on a channel."""
        self._offers.pop(key, None)

    def on_data(self, key: tuple[int, int], data: bytes) -> None:
        """Check a client's message and pass it on."""
        if key not in self._offers:
            return  # the client was told when it offered
        topic, encoding, _ = self._offers[key]
        _, kind = self._inputs[topic]
        try:
            message = _message(kind, encoding, data)
            position = message.pose.position
            if kind is PoseWithCovarianceStamped:
                position = message.pose.pose.position
                convert.to_yaw(message.pose.pose.orientation)
            x, y = convert.to_goal(message.header.frame_id, position)
        except ValueError as error:
            self._complain(f"refused what came for {topic}: {error}")
            return
        self.get_logger().info(f"({x:g}, {y:g}) from a client to {topic}")
        self._held[topic] = message, time.monotonic() + HEARING
        self._pass_on()

    def _pass_on(self) -> None:
        """Publish the held message once somebody subscribes: discovery takes some time."""
        for topic, (message, until) in list(self._held.items()):
            publisher, _ = self._inputs[topic]
            if publisher.get_subscription_count():
                message.header.stamp = self.get_clock().now().to_msg()
                publisher.publish(message)
            elif time.monotonic() < until:
                continue
            else:
                self._complain(f"nobody takes {topic}: start the stack, then send it again")
            del self._held[topic]

    def _complain(self, text: str) -> None:
        """Report to the clients and the log, at a limited rate."""
        now, recent = time.monotonic(), self._complaints
        if len(recent) == MOST_COMPLAINTS and now - recent[0] < QUIET:
            return
        recent.append(now)
        self._server.publish_status(text, foxglove.StatusLevel.Warning)
        self.get_logger().warning(text)

    def close(self) -> None:
        """Disconnect the clients."""
        self._server.stop()


def _message(kind: Any, encoding: str, data: bytes) -> Any:
    """Decode the message that a client sent.

    Raises:
        ValueError: if it is not a message.
    """
    if encoding == "cdr":
        try:
            if len(data) > MOST_BYTES:
                raise ValueError(f"it has {len(data)} bytes, more than {MOST_BYTES}")
            return deserialize_message(data, kind)
        except RuntimeError:
            raise ValueError(f"it is not a {kind.__name__} in CDR") from None
    found = parse_pose(data)
    message = kind()
    pose = message.pose if kind is PoseStamped else message.pose.pose
    message.header.frame_id = found.frame
    pose.position = Point(**dict(zip("xyz", found.position, strict=True)))
    pose.orientation = Quaternion(**dict(zip("xyzw", found.orientation, strict=True)))
    return message


def main() -> None:
    """Serve until SIGINT or SIGTERM."""
    usage = (
        "usage: bicycle_foxglove [--ros-args -p NAME:=VALUE ... --params-file FILE]\n\n"
        "Serves all topics to Foxglove. Parameters and their defaults:\n"
        + describe(FoxgloveSettings)
    )
    sys.exit(run(NAME, FoxgloveServer, usage))
