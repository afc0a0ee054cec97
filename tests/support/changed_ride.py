"""Rides whose messages are changed one by one, and bags of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from copy import deepcopy
from functools import reduce
from pathlib import Path
from typing import Any

from bicycle_msgs.msg import Push as PushMessage
from rclpy.serialization import serialize_message
from ride_bag_maker import TOPICS, Message

from bicycle_bag.metadata import Topic
from bicycle_bag.schemas import Schemas
from bicycle_bag.writer import BagWriter
from bicycle_common.nodes.topics import COMMAND, COMMAND_ECHO, EPISODE, PUSHED, STATE
from bicycle_tools.nodes import ride_recording, verify_states

STEPS = 60
STATES, COMMANDS, ECHOES, EPISODES, PUSHES = (
    f"/{topic.name}" for topic in (STATE, COMMAND, COMMAND_ECHO, EPISODE, PUSHED)
)
KINDS = {name: topic.type for name, topic in TOPICS.items()} | {PUSHES: PushMessage}
"""Type of each topic that a verification reads."""
Change = Callable[[str, Any], Iterable[tuple[str, Any]]]


def changed(ride: list[Message], change: Change) -> list[Message]:
    """Return the ride with each message replaced by what `change` makes of it."""
    changed_ride = []
    for name, message, time in ride:
        changed_ride += [(topic, item, time) for topic, item in change(name, deepcopy(message))]
    return changed_ride


def without(topic: str, *steps: int) -> Change:
    """Leave out the messages of a topic at some steps, at all if none is given."""

    def change(name: str, message: Any) -> Iterator[tuple[str, Any]]:
        if name != topic or (steps and message.step not in steps):
            yield name, message

    return change


def with_field(topic: str, step: int, field: str, value: Any) -> Change:
    """Set a field of a topic's message at a step."""

    def change(name: str, message: Any) -> Iterator[tuple[str, Any]]:
        if name == topic and message.step == step:
            *parts, last = field.split(".")
            holder = reduce(getattr, parts, message)
            setattr(holder, last, value(getattr(holder, last)) if callable(value) else value)
        yield name, message

    return change


def judged(path: Path, ride: list[Message], prefix: str = "") -> verify_states.StateVerdict:
    """Return the verdict of a bag with these messages."""
    recording = ride_recording.read(recorded(path, ride, prefix))
    (*_, verdict) = verify_states.verify(recording)
    return verdict


def recorded(path: Path, ride: list[Message], prefix: str = "") -> Path:
    """Record messages, with pushes, below a namespace."""
    schemas = Schemas()
    with BagWriter(path) as writer:
        for name, kind in KINDS.items():
            full = f"bicycle_msgs/msg/{kind.__name__}"
            topic = Topic(prefix + name, full, type_hash=schemas.type_hash(full))
            writer.add_topic(topic, schemas.definition(full))
        for name, message, time in ride:
            writer.write(prefix + name, serialize_message(message), time, time)
    return path
