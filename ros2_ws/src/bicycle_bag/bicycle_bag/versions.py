"""Conversion of messages of earlier versions to the installed version of their type.

A field that an earlier version lacked is zero or empty, or no number (see UNKNOWN); one that the
installed version lacks is left out. Up to version 2 a BicycleState named the command that led to
it; the echo that today's simulator publishes is made from that and from the commands of the bag.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

from mcap_ros2._dynamic import serialize_dynamic

from bicycle_bag.decoding import decoder
from bicycle_bag.errors import BagError
from bicycle_bag.metadata import Topic
from bicycle_bag.own_types import OURS
from bicycle_bag.reader import BagMessage, BagReader
from bicycle_bag.schemas import SEPARATOR, Schemas, fields
from bicycle_common import topic_names
from bicycle_common.types import CommandSource

STATE, COMMAND, ECHO = (
    topic_names.in_bag(name)
    for name in (topic_names.STATE, topic_names.COMMAND, topic_names.COMMAND_ECHO)
)
COMMAND_IN_STATE = ("command_source", "command_step", "controller", "has_goal", "goal")
"""Fields of a state up to version 2."""
UNKNOWN = {f"{OURS}BicycleCommand": ("heading_error", "goal_distance")}
"""Fields that are not a number, instead of zero, where an earlier version lacked them."""
AHEAD = 64
"""Messages within which a command may be recorded after the state that it led to."""
Encode = Callable[[Any], bytes]
Commands = dict[str, dict[tuple[int, int, str], Any]]
"""Commands by topic of the states, then by episode, step and sender."""


class TodaysReader(BagReader):
    """A bag, read as today's release would have recorded it.

    Messages of bicycle_msgs come in the installed versions of their types, and before each state
    of version 2 or less comes the echo of the command that led to it.

    Args:
        path: Bag directory or MCAP file.

    Raises:
        BagError: See `BagReader`.
    """

    def __init__(self, path: Path | str) -> None:
        super().__init__(path)
        self._schemas = Schemas()
        self._encoders: dict[str, tuple[Callable[[bytes], Any], Encode] | None] = {}
        self._decoders: dict[str, Callable[[bytes], Any]] = {}
        self._write_echo: Encode | None = None
        recorded = super().topics
        self._echoed = {
            name: name.removesuffix(STATE) + ECHO
            for name in recorded
            if name.endswith(STATE) and self._names_commands(name)
        }
        self._commanded = {
            state.removesuffix(STATE) + COMMAND: state
            for state in self._echoed
            if state.removesuffix(STATE) + COMMAND in recorded
        }

    @property
    def topics(self) -> dict[str, Topic]:
        """Topics by name, with those of the echoes."""
        found = super().topics
        for state, echo in self._echoed.items():
            found[echo] = Topic(echo, f"{OURS}CommandEcho", found[state].qos)
        return found

    @property
    def counts(self) -> dict[str, int]:
        """Messages of each topic, with the echoes."""
        found = super().counts
        return found | {echo: found[state] for state, echo in self._echoed.items()}

    @property
    def message_count(self) -> int:
        """Messages of all topics, with the echoes."""
        return sum(self.counts.values())

    def require(self, topics: Collection[str]) -> None:
        """Check that the bag has these topics; see `BagReader.require`."""
        super().require([name for name in topics if name not in self._echoed.values()])

    def missing_fields(self, topic: str) -> list[str]:
        """Return the names of fields that a topic's type has got since the bag was recorded."""
        if topic in self._echoed.values():
            return []
        old, new = self._both(topic)
        return [name for name in new if name not in old]

    def is_rewritten(self, topic: str) -> bool:
        """Return True if the messages of a topic were recorded in an earlier version."""
        return topic in self._echoed.values() or self._encoder(topic) is not None

    def messages(self, topics: Collection[str] | None = None) -> Iterator[BagMessage]:
        """Messages in the order they were recorded, as today's release would have recorded them.

        Args:
            topics: Only these; all by default.

        Raises:
            BagError: See `BagReader.messages`; or a message is not of its recorded type.
        """
        if topics is None:
            topics = list(self.topics)
        wanted, needed = set(topics), set(topics) - set(self._echoed.values())
        needed |= {state for state, echo in self._echoed.items() if echo in wanted}
        needed |= {name for name, state in self._commanded.items() if state in needed}
        commands: Commands = {}
        for item in self._read_ahead(super().messages(needed), commands):
            two_ways = self._encoder(item.topic) if self._is_own(item) else None
            if two_ways is None:
                if item.topic in wanted:
                    yield item
                continue
            old = self._read(item, two_ways[0])
            if self._echoed.get(item.topic) in wanted:
                yield self._echo(item, old, commands.get(item.topic, {}))
            if item.topic in wanted:
                yield item._replace(data=two_ways[1](old))

    def _read_ahead(self, items: Iterator[BagMessage], commands: Commands) -> Iterator[BagMessage]:
        """Yield messages; put commands into `commands`, also those recorded soon after a state."""
        ahead: deque[BagMessage] = deque()
        for item in items:
            if item.topic in self._commanded and self._is_own(item):
                if item.topic not in self._decoders:
                    self._decoders[item.topic] = self._decode(item.topic)
                command = self._read(item, self._decoders[item.topic])
                key = command.episode, command.step, command.controller
                commands.setdefault(self._commanded[item.topic], {})[key] = command
            ahead.append(item)
            if len(ahead) > AHEAD:
                yield ahead.popleft()
        yield from ahead

    def _echo(
        self, item: BagMessage, old: Any, commands: dict[tuple[int, int, str], Any]
    ) -> BagMessage:
        """Return the echo of the command that led to a state of version 2 or less."""
        kind = f"{OURS}CommandEcho"
        sender = old.controller if old.command_step >= 0 else ""
        key = old.episode, old.command_step, sender
        command = commands.get(key) if sender else None
        if command is None:
            unknown = math.nan if old.command_source in _DRIVEN else 0.0
            names = ("torque", "displacement", "pedal_force")
            command = {
                "episode": old.episode,
                "step": max(0, old.command_step),
                "controller": sender,
                "has_goal": old.has_goal,
                "goal": old.goal,
                **dict.fromkeys(names, unknown),
                **dict.fromkeys(UNKNOWN[f"{OURS}BicycleCommand"], math.nan),
            }
        echo = {
            "header": old.header,
            "episode": old.episode,
            "step": old.step,
            "command_source": old.command_source,
            "command": command,
        }
        if self._write_echo is None:
            self._write_echo = _encode(kind, self._schemas)
        data = self._write_echo(echo)
        return item._replace(topic=self._echoed[item.topic], type=kind, data=data)

    def _both(self, topic: str) -> tuple[list[str], list[str]]:
        """Return the names of the fields of a topic's type, as recorded and as installed.

        None where one is not known, or where a field has another type than it had.
        """
        recorded = self._definitions.get(topic, "")
        if not recorded:
            return [], []
        try:
            installed = self._schemas.definition(self._topics[topic].type)
        except BagError:
            return [], []
        old, new = _fields(recorded), _fields(installed)
        if any(old[name] != new[name] for name in old.keys() & new.keys()):
            return [], []
        return list(old), list(new)

    def _names_commands(self, topic: str) -> bool:
        """Return True if a topic's states are of version 2 or less, which name their command."""
        old, new = self._both(topic)
        return all(name in old and name not in new for name in COMMAND_IN_STATE)

    def _encoder(self, topic: str) -> tuple[Callable[[bytes], Any], Encode] | None:
        """Return reader and writer of a topic's messages; None if they need no rewriting."""
        if topic not in self._encoders:
            kind = self._topics[topic].type
            old, new = self._both(topic) if kind.startswith(OURS) else ([], [])
            self._encoders[topic] = None
            if old != new:
                self._encoders[topic] = self._decode(topic), _encode(kind, self._schemas)
        return self._encoders[topic]

    def _decode(self, topic: str) -> Callable[[bytes], Any]:
        kind = self._topics[topic].type
        return decoder(topic, kind, self._definitions[topic])

    def _is_own(self, item: BagMessage) -> bool:
        """Return True if a message is of its topic's type, which its definition decodes."""
        return item.encoding == "cdr" and item.type == self._topics[item.topic].type

    def _read(self, item: BagMessage, decode: Callable[[bytes], Any]) -> Any:
        try:
            found = decode(item.data)
            for name in UNKNOWN.get(item.type, ()):
                if not hasattr(found, name):
                    setattr(found, name, math.nan)
            return found
        except Exception as error:  # whatever the decoder makes of foreign bytes
            raise BagError(
                f"a message of {len(item.data)} bytes is not a {item.type.rpartition('/')[2]} "
                f"({' '.join(str(error).split())[:100]}): the bag's recorder was another version "
                "or the message was damaged before it was recorded"
            ) from None


_DRIVEN = (CommandSource.FRESH, CommandSource.HELD)


def _fields(definition: str) -> dict[str, tuple[str, str]]:
    """Return type and array of each field, by name."""
    found = fields(definition.partition(SEPARATOR)[0])
    return {field.name: (field.type, field.array) for field in found}


def _encode(kind: str, schemas: Schemas) -> Encode:
    """Return the writer of a message of an installed type; omitted fields are zero."""
    package, _, name = kind.split("/")
    encode: Encode = serialize_dynamic(kind, schemas.definition(kind))[f"{package}/{name}"]
    return encode
