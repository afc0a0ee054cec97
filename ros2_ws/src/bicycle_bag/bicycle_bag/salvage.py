"""Reads all that can be read of a damaged MCAP file, and counts what cannot."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from mcap.opcode import Opcode

from bicycle_bag import container, metadata
from bicycle_bag.container import ENTRY
from bicycle_bag.contents import Contents
from bicycle_bag.errors import BagError
from bicycle_bag.message_packing import is_packed
from bicycle_bag.walk import WRONG_CHECKSUM, Damage, Piece
from bicycle_common import yaml_text

Progress = Callable[[int], object]


class Salvage:
    """One file as it is read: its contents and its losses.

    Attributes:
        contents: The file, with channels, and messages by channel.
        custom_data: From the metadata in it.
        damages: What it holds besides.
        unproved: Messages that have no checksum of their own.
        packed: Messages that are compressed one by one.
        is_rosbag2: True if it has rosbag2's metadata in it.

    Raises:
        BagError: The file cannot be read, or is of another kind.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.contents = Contents(path)
        self.custom_data: dict[str, str] = {}
        self.damages: list[Damage] = []
        self.unproved = 0
        self.packed = 0
        self.is_rosbag2 = False
        self._index: dict[int, bytearray] = {}

    @property
    def messages(self) -> int:
        """Number of messages found."""
        return sum(self.contents.counts.values())

    @property
    def explained(self) -> bool:
        """True if the place of the damage is known, not only its existence."""
        return any(one.what != WRONG_CHECKSUM for one in self.damages)

    @property
    def whole(self) -> bool:
        """True if, once read, the file has its index, no damage, and messages as they are."""
        return self.contents.summary is not None and not self.damages and not self.packed

    def pieces(self, progress: Progress) -> Iterator[Piece]:
        """Yield everything valid.

        Args:
            progress: Called with the number of bytes read since the last call.
        """
        end = 0
        for found in self.contents.pieces():
            progress(max(0, found.end - end))
            end = max(end, found.end)
            if isinstance(found, Damage):
                self.damages.append(found)
                continue
            if found.content is None or not found.content.has_checksum:
                self.unproved += sum(item.opcode == Opcode.MESSAGE for item in found.items)
            registry = self.contents.registry
            self.packed += sum(is_packed(item, registry) for item in found.items)
            if found.opcode == Opcode.METADATA:
                self._remember(found.body)
            elif found.opcode == Opcode.CHUNK:
                self._index = container.message_index(found.items)
            elif found.opcode == Opcode.MESSAGE_INDEX and not self._indexes(found.body):
                self.damages.append(Damage(found.offset, found.offset, "an index is wrong"))
            yield found
        if not self.damages and (wrong := self.contents.miscounted):
            self.damages.append(Damage(self.contents.size, self.contents.size, wrong))
        progress(self.contents.size - end)

    def _indexes(self, body: bytes) -> bool:
        """Return True if a message index agrees with the chunk before it."""
        entries = self._index.get(container.channel_of(body), b"")
        return sorted(ENTRY.iter_unpack(entries)) == sorted(ENTRY.iter_unpack(body[6:]))

    def _remember(self, body: bytes) -> None:
        record = container.parse_metadata(body)
        self.is_rosbag2 = self.is_rosbag2 or record.name == "rosbag2"
        text = record.metadata.get("serialized_metadata", "")
        try:
            stored = metadata.from_yaml_map(yaml_text.load(text), of_any_storage=True)
        except (yaml_text.YAMLError, BagError, *metadata.NOT_METADATA):
            return
        self.custom_data.update(stored.custom_data)
