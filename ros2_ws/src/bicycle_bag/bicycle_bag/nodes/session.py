"""Common part of recorder and player: start of ROS, types and QoS."""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Iterator, Sequence
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)

from bicycle_bag import qos
from bicycle_bag.errors import BagError, OptionError
from bicycle_common.nodes.runner import UserError, start_ros


@contextlib.contextmanager
def ros_node(name: str, arguments: Sequence[str]) -> Iterator[Node]:
    """Create a plain node in a context of its own, and shut both down at the end.

    Raises:
        OptionError: ROS does not start with these arguments or this environment.
        BagError: The middleware cannot make the node.
    """
    try:
        start_ros(arguments)
        node = rclpy.create_node(name, enable_rosout=False, start_parameter_services=False)
    except UserError as error:
        raise OptionError(str(error)) from None
    except Exception as error:  # rcl's errors have no common public base
        rclpy.try_shutdown()
        reason = " ".join(str(error).split())
        raise BagError(f"ROS does not start ({reason}): check --ros-args and ROS_*") from None
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


@contextlib.contextmanager
def further_node(name: str, arguments: Sequence[str]) -> Iterator[Node]:
    """Create a plain node that meets all others afresh, beside that of `ros_node`.

    A context of its own is a participant of its own in the middleware.
    """
    context = Context()
    context.init(args=list(arguments))
    node = rclpy.create_node(
        name, context=context, enable_rosout=False, start_parameter_services=False
    )
    try:
        yield node
    finally:
        node.destroy_node()
        context.try_shutdown()


def message_class(type_name: str) -> type[Any]:
    """Return the Python class of `pkg/msg/Type`.

    Raises:
        BagError: It is not installed here.
    """
    package, _, name = type_name.partition("/msg/")
    if not (package.isidentifier() and name.isidentifier()):
        raise BagError(f"its type is {type_name!r}, which is not one of ROS 2's messages")
    try:
        found: type[Any] = getattr(importlib.import_module(f"{package}.msg"), name)
        found.get_fields_and_field_types()
    except (ImportError, AttributeError, TypeError, ValueError):
        raise BagError(f"{type_name} is not installed: source the workspace that has it") from None
    return found


def offered(profile: QoSProfile) -> qos.QosProfile:
    """Return a publisher's offer as discovery reports it, in the form that bags store."""
    return qos.QosProfile(
        history=profile.history.name.lower(),
        depth=int(profile.depth),
        reliability=profile.reliability.name.lower(),
        durability=profile.durability.name.lower(),
        deadline=int(profile.deadline.nanoseconds),
        lifespan=int(profile.lifespan.nanoseconds),
        liveliness=profile.liveliness.name.lower(),
        liveliness_lease_duration=int(profile.liveliness_lease_duration.nanoseconds),
        avoid_ros_namespace_conventions=bool(profile.avoid_ros_namespace_conventions),
    )


def subscription_profile(reliable: bool, transient_local: bool, depth: int) -> QoSProfile:
    """Return a subscription's profile that hears publishers of at least this quality."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL
        if transient_local
        else DurabilityPolicy.VOLATILE,
    )


def overridden_profile(wanted: qos.QosProfile, queue: int) -> QoSProfile:
    """Return a subscription's profile from the user's; a depth of 0 takes `queue`."""
    return QoSProfile(
        history=HistoryPolicy[wanted.history.upper()],
        depth=wanted.depth or queue,
        reliability=ReliabilityPolicy[wanted.reliability.upper()],
        durability=DurabilityPolicy[wanted.durability.upper()],
        deadline=Duration(nanoseconds=wanted.deadline),
        lifespan=Duration(nanoseconds=wanted.lifespan),
        liveliness=LivelinessPolicy[wanted.liveliness.upper()],
        liveliness_lease_duration=Duration(nanoseconds=wanted.liveliness_lease_duration),
        avoid_ros_namespace_conventions=wanted.avoid_ros_namespace_conventions,
    )


def publisher_profile(recorded: Sequence[qos.QosProfile], depth: int, latched: int) -> QoSProfile:
    """Return the recorded offer if all publishers agreed, as rosbag2 replays it, else the default.

    Args:
        recorded: What the publishers offered.
        depth: Messages to keep for slow subscribers.
        latched: Messages to keep for late subscribers, of a transient-local topic.
    """
    first = recorded[0] if recorded and all(offer == recorded[0] for offer in recorded) else None
    offer = first or qos.QosProfile()
    known = "unknown", "system_default", "best_available"
    reliability = "reliable" if offer.reliability in known else offer.reliability
    durability = "volatile" if offer.durability in known else offer.durability
    liveliness = "automatic" if offer.liveliness in known else offer.liveliness
    if liveliness == "manual_by_node":  # rclpy no longer has it
        liveliness = "automatic"
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=latched if durability == "transient_local" else depth,
        reliability=ReliabilityPolicy[reliability.upper()],
        durability=DurabilityPolicy[durability.upper()],
        deadline=Duration(nanoseconds=offer.deadline),
        lifespan=Duration(nanoseconds=offer.lifespan),
        liveliness=LivelinessPolicy[liveliness.upper()],
        liveliness_lease_duration=Duration(nanoseconds=offer.liveliness_lease_duration),
    )
