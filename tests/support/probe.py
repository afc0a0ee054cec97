"""A node inside the test: it hears, says and calls whatever a test needs."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable
from functools import partial
from typing import Any

import rclpy
from bicycle_msgs.msg import BicycleCommand, BicycleState
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.srv import ListParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from waiting import PATIENCE

from bicycle_common.nodes.topics import COMMAND, STATE, Service, Topic


class Probe:
    """Keeps every message of the topics that it was told to hear, by name, in order."""

    def __init__(self, domain: int, *topics: Topic, namespace: str = "") -> None:
        self.context = Context()
        rclpy.init(args=[], context=self.context, domain_id=domain)
        self.node = rclpy.create_node("probe", context=self.context, namespace=namespace)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.heard: dict[str, list[Any]] = defaultdict(list)
        self._publishers: dict[str, Any] = {}
        self._subscriptions: dict[str, Any] = {}
        self.on_state: Callable[[BicycleState], BicycleCommand | None] | None = None
        for topic in topics:
            self._hear(topic)

    def _hear(self, topic: Topic) -> None:
        def keep(message: Any) -> None:
            self.heard[topic.name].append(message)
            if topic is STATE and self.on_state is not None:
                answer = self.on_state(message)
                if answer is not None:
                    self.say(COMMAND, answer)

        wanted = topic.subscribe
        profile = QoSProfile(
            depth=1000, reliability=wanted.reliability, durability=wanted.durability
        )
        subscription = self.node.create_subscription(topic.type, topic.name, keep, profile)
        self._subscriptions[topic.name] = subscription

    def meet(self, *topics: Topic) -> None:
        """Wait until each of these topics has a publisher, and its node knows this subscriber.

        A topic that is not latched and says something once would be missed otherwise. That a
        publisher is known here does not mean that it knows the subscriber. Endpoints become known
        in the order in which they were made, so a node that answers a later client does.
        """
        for topic in topics:
            for node in self.spin_until(partial(self._publishing, topic)):
                service = Service(f"{node}/list_parameters", ListParameters)
                self.call(service, ListParameters.Request())

    def _publishing(self, topic: Topic) -> list[str]:
        """Return the nodes that publish a topic; none before all of them are known by name."""
        name = self._subscriptions[topic.name].topic_name
        ends = self.node.get_publishers_info_by_topic(name)
        names = [f"{end.node_namespace.rstrip('/')}/{end.node_name}" for end in ends]
        return [] if any("_NODE_NAME" in one for one in names) else names

    def __getitem__(self, topic: Topic) -> list[Any]:
        return self.heard[topic.name]

    def spin_until(self, condition: Callable[[], Any], patience: float = PATIENCE) -> Any:
        """Serve callbacks until `condition` holds; returns what it gave."""
        deadline = time.monotonic() + patience
        while not (value := condition()):
            assert time.monotonic() < deadline, (
                f"waited {patience} s in vain; {self._heard_last()}"
            )
            self.executor.spin_once(timeout_sec=0.05)
        return value

    def _heard_last(self) -> str:
        """Return how many messages of each topic were heard, and the last of each."""
        lines = [
            f"{len(messages)} of {name}, the last: {str(messages[-1])[:600]}"
            for name, messages in self.heard.items()
            if messages
        ]
        return "\n".join(["heard", *lines]) if lines else "nothing was heard"

    def spin_while(self, condition: Callable[[], Any], longest: float) -> None:
        """Serve callbacks while `condition` holds, at most for a while."""
        deadline = time.monotonic() + longest
        while condition() and time.monotonic() < deadline:
            self.executor.spin_once(timeout_sec=0.02)

    def spin_for(self, seconds: float) -> None:
        """Serve callbacks for a while, to see that something does not happen."""
        self.spin_while(lambda: True, seconds)

    def publisher(self, topic: Topic, recorder: bool = False) -> Any:
        """Return a publisher that somebody listens to: a recorder alone only counts if asked."""
        if topic.name not in self._publishers:
            publisher = self.node.create_publisher(topic.type, topic.name, topic.publish)
            self._publishers[topic.name] = publisher
            self.spin_until(lambda: self._is_heard(publisher, recorder))
        return self._publishers[topic.name]

    def _is_heard(self, publisher: Any, recorder: bool) -> bool:
        """Return True if all known subscribers are connected, and one of them is meant."""
        ends = self.node.get_subscriptions_info_by_topic(publisher.topic_name)
        meant = [recorder or not str(end.node_name).startswith("bicycle_recorder") for end in ends]
        return any(meant) and int(publisher.get_subscription_count()) >= len(ends)

    def say(self, topic: Topic, message: Any, recorder: bool = False) -> None:
        """Publish a message; with `recorder` it is enough that a recorder hears it."""
        self.publisher(topic, recorder).publish(message)

    def call(self, service: Service, request: Any) -> Any:
        """Return the answer of a service."""
        client = self.node.create_client(service.type, service.name)
        self.spin_until(client.service_is_ready)
        future = client.call_async(request)
        self.spin_until(future.done)
        result = future.result()
        self.node.destroy_client(client)
        return result

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


def command(state: BicycleState, **changes: Any) -> BicycleCommand:
    """Return a valid answer that keeps an upright bicycle upright, with `changes`."""
    values = {"episode": state.episode, "step": state.step, "controller": "probe", **changes}
    return BicycleCommand(**values)


def goal(x: float, y: float, frame: str = "odom") -> PoseStamped:
    """Return a goal at a place, m."""
    pose = PoseStamped()
    pose.header.frame_id = frame
    pose.pose.position.x, pose.pose.position.y = float(x), float(y)
    return pose
