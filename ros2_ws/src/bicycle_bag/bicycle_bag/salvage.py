"""Reads all that can be read of a damaged MCAP file, and counts what cannot."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from mcap.opcode import Opcode

from bicycle_bag import container, metadata
from bicycle_bag.container import DamageError, RawMessage, Record, Registry
from bicycle_bag.errors import BagError
from bicycle_sim import yaml_text

Progress = Callable[[int], object]


class Salvage:
    """One file as it is read: what it holds and what was lost.

    Args:
        path: MCAP file; nothing need be right behind its first byte.

    Raises:
        BagError: The file cannot be read, or is of another kind (from ``messages``).
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.registry = Registry()
        self.custom_data: dict[str, str] = {}
        self.lost_bytes = 0
        self.lost_chunks = 0
        self.lost_messages = 0
        self.indexed = False
        self._finished = False
        self._size = container.size_of(path)
        # A finished file repeats its channels at the end, so a lost chunk takes none with it.
        with container.open_binary(path) as stream:
            try:
                self.registry = container.read_summary(stream, self._size).registry
                self.indexed = True
            except DamageError:
                pass

    @property
    def lossless(self) -> bool:
        """Whether every message has come out, so far as one can know."""
        return not (self.lost_bytes or self.lost_chunks or self.lost_messages)

    @property
    def whole(self) -> bool:
        """Whether the file has its index and every record is right."""
        return self.indexed and self._finished and self.lossless

    def messages(self, progress: Progress) -> Iterator[RawMessage]:
        """Messages up to the end, or to where no record can be found any more."""
        end = 0
        all_data_read = False
        with container.open_binary(self.path) as stream:
            try:
                container.check_magic(self.path, stream)
                end = stream.tell()
                for offset, record in container.records(stream, self._size):
                    yield from self._contents(record)
                    all_data_read = all_data_read or record.opcode == Opcode.DATA_END
                    end = stream.tell()
                    progress(end - offset)
                self._finished = True
            except DamageError:
                self.lost_bytes = 0 if all_data_read else self._size - end

    def _contents(self, record: Record) -> Iterator[RawMessage]:
        if record.opcode != Opcode.CHUNK:
            yield from self._take(record)
            return
        try:
            for inner in container.chunk_records(record.body):
                yield from self._take(inner)
        except DamageError:
            self.lost_chunks += 1

    def _take(self, record: Record) -> Iterator[RawMessage]:
        if record.opcode == Opcode.METADATA:
            self._remember(record)
        elif record.opcode != Opcode.MESSAGE:
            self.registry.take(record)
        else:
            message = container.parse_message(record.body)
            if message.channel_id in self.registry.channels:
                yield message
            else:
                self.lost_messages += 1

    def _remember(self, record: Record) -> None:
        text = container.parse_metadata(record.body).metadata.get("serialized_metadata", "")
        try:
            stored = metadata.from_yaml_map(yaml_text.load(text))
        except (yaml_text.YAMLError, BagError, KeyError, TypeError, ValueError, AttributeError):
            return
        self.custom_data.update(stored.custom_data)
