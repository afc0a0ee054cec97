"""The messages of a bag from which its states can be computed again.

Bags whose topics have other types, encodings or versions are refused in one line.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bicycle_msgs.msg import BicycleCommand, BicycleState, CommandEcho, EpisodeInfo, Push
from rclpy.serialization import deserialize_message

from bicycle_bag.errors import BagError
from bicycle_bag.schemas import Schemas
from bicycle_bag.versions import TodaysReader
from bicycle_common.nodes import convert
from bicycle_common.types import Command
from bicycle_tools.ride_log import COMMAND, ECHO, EPISODE, PUSHED, STATE, prefix_of

Key = tuple[int, int, str]
"""Episode, step and controller, which identify an applied command's candidates."""


@dataclass
class Recording:
    """The messages of one bicycle, in recorded order."""

    states: list[tuple[int, bytes]] = field(default_factory=list)
    """Place in the recorded order, and CDR."""
    missing: frozenset[str] = frozenset()
    """Fields of today's states that the bag's have not."""
    echoes: dict[tuple[int, int], list[tuple[int, CommandEcho]]] = field(
        default_factory=lambda: defaultdict(list)
    )
    """Place and message by episode and step of the state that the command led to."""
    commands: dict[Key, list[Command]] = field(default_factory=lambda: defaultdict(list))
    episodes: list[tuple[int, EpisodeInfo]] = field(default_factory=list)
    """Place in the recorded order, and message."""
    pushes: dict[tuple[int, int], list[float]] = field(default_factory=lambda: defaultdict(list))
    """Pushes by episode and step of the pushed state, rad/s, in the paper's signs."""


def read(path: Path) -> Recording:
    """Read the messages that a verification needs.

    Raises:
        BagError: if the bag cannot be read, is foreign, or has other message definitions.
    """
    reader = TodaysReader(path)
    prefix = prefix_of(reader)
    kinds = {prefix + STATE: BicycleState, prefix + COMMAND: BicycleCommand}
    kinds[prefix + EPISODE] = EpisodeInfo
    reader.require(list(kinds))
    _check_kinds(reader, kinds)
    kinds[prefix + ECHO] = CommandEcho
    if prefix + ECHO not in reader.topics:
        raise BagError(
            f"{path} does not say which command led to which state (no {ECHO}): only a bag of a "
            "simulator can be verified"
        )
    if prefix + PUSHED in reader.topics:  # older bags lack it
        kinds[prefix + PUSHED] = Push
    _check_kinds(reader, kinds)
    _check_versions(reader, list(kinds))
    recording = Recording(missing=frozenset(reader.missing_fields(prefix + STATE)))
    # The recorded order is reliable; the recording's clock may have been set in the meantime.
    for place, item in enumerate(reader.messages(list(kinds))):
        kind = kinds[item.topic]
        _check_kind(path, item.topic, item.type, item.encoding, kind)
        if kind is BicycleState:
            recording.states.append((place, item.data))
            continue
        message = decoded(item.data, kind)
        if kind is BicycleCommand:
            command = convert.to_command(message)
            key = command.episode, command.step, command.controller
            recording.commands[key].append(command)
        elif kind is CommandEcho:
            recording.echoes[message.episode, message.step].append((place, message))
        elif kind is Push:
            push = convert.to_push(message)
            recording.pushes[push.episode, push.step].append(push.lean_rate)
        else:
            recording.episodes.append((place, message))
    return recording


def _check_kinds(reader: TodaysReader, kinds: dict[str, type[Any]]) -> None:
    """Refuse topics of other types or encodings; see `_check_kind`."""
    for name, kind in kinds.items():
        topic = reader.topics[name]
        _check_kind(reader.path, name, topic.type, topic.serialization_format, kind)


def _check_kind(path: Path, topic: str, type_name: str, encoding: str, kind: type[Any]) -> None:
    """Refuse messages of other types or encodings.

    Raises:
        BagError: if there are any.
    """
    wanted = f"bicycle_msgs/msg/{kind.__name__}"
    if type_name != wanted or encoding != "cdr":
        raise BagError(
            f"{path} holds {topic} as {type_name or 'no type'} in {encoding or 'no encoding'}, "
            f"where {wanted} in cdr is needed: record the ride with record.sh or ros2 bag record"
        )


def _check_versions(reader: TodaysReader, topics: list[str]) -> None:
    """Refuse a bag whose messages cannot be brought up to date.

    Raises:
        BagError: if it is one.
    """
    schemas = Schemas()
    for name in topics:
        topic = reader.topics[name]
        known = reader.is_rewritten(name) or topic.type_hash == schemas.type_hash(topic.type)
        if topic.type_hash and not known:
            raise BagError(
                f"{reader.path} has another version of {topic.type}: verify it with the release "
                "that recorded it"
            )


def decoded(data: bytes, kind: type[Any]) -> Any:
    """Decode a message from its CDR.

    Args:
        data: the message as the reader gives it.
        kind: its class.

    Raises:
        BagError: if it is not of this kind.
    """
    try:
        return deserialize_message(data, kind)
    except Exception as error:  # the middleware's errors have no common base class
        raise BagError(
            f"a message of {len(data)} bytes is not a {kind.__name__} "
            f"({' '.join(str(error).split())[:100]}): the bag's recorder was another version or "
            "the message was damaged before it was recorded"
        ) from None
