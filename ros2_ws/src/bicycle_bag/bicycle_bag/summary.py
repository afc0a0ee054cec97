"""Summary at the end of a finished MCAP file: channels, counts and offsets."""

from __future__ import annotations

import struct
import zlib
from typing import BinaryIO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Footer, Statistics

from bicycle_bag import container
from bicycle_bag.container import HEAD, MAGIC, DamageError, Registry

DATA_END_BYTES = HEAD.size + 4
_FOOTER_BYTES = HEAD.size + 20
_PLACE = struct.Struct("<QQ")
_PLACED: dict[int, int] = {
    Opcode.ATTACHMENT_INDEX: Opcode.ATTACHMENT,
    Opcode.METADATA_INDEX: Opcode.METADATA,
}
_WRONG_BITS = 3
_OF_DATA = {
    Opcode.HEADER,
    Opcode.MESSAGE,
    Opcode.CHUNK,
    Opcode.MESSAGE_INDEX,
    Opcode.ATTACHMENT,
    Opcode.METADATA,
    Opcode.DATA_END,
}
"""Kinds of records that no summary has."""
_MESSAGE_INDEX_BYTES, _ENTRY_BYTES = HEAD.size + 6, 16


class Place(NamedTuple):
    """Entry of an index for a record: its kind, and its length with its head."""

    opcode: int
    length: int


class Summary(NamedTuple):
    """The summary of a finished file; `statistics` may be missing.

    `places` has records that an index names, by offset; `data_end` is the offset of the record
    that ends the data, or of what follows if `has_data_end` is False. `has_checksum` is True if a
    checksum proves it all.
    """

    registry: Registry
    statistics: Statistics | None
    chunks: list[ChunkIndex]
    places: dict[int, Place]
    data_end: int
    has_checksum: bool = False
    has_data_end: bool = True

    @property
    def agrees(self) -> bool:
        """True if counts and times of the statistics fit each other and what else is known.

        Those of a file without chunks are proved by a checksum only, and what a writer has
        counted wrong by none.
        """
        found = self.statistics
        if found is None or sum(found.channel_message_counts.values()) != found.message_count:
            return False
        if not found.message_count:
            return True
        if not self.is_chunked or not any(one.message_index_length for one in self.chunks):
            return self.has_checksum and found.message_start_time <= found.message_end_time
        filled = [one for one in self.chunks if one.message_index_length]
        first = min(one.message_start_time for one in filled)
        last = max(one.message_end_time for one in filled)
        span = found.message_start_time, found.message_end_time
        return span == (first, last) and self._indexed == found.message_count

    @property
    def _indexed(self) -> int:
        """Number of messages in all chunks by the lengths of their indexes."""
        return sum(
            (one.message_index_length - _MESSAGE_INDEX_BYTES * len(one.message_index_offsets))
            // _ENTRY_BYTES
            for one in self.chunks
        )

    @property
    def complete(self) -> bool:
        """True if it names every channel with its schema, and counts each one's messages."""
        found, channels = self.statistics, self.registry.channels
        if found is None or (found.message_count and not found.channel_message_counts):
            return False
        schemas = {channel.schema_id for channel in channels.values()} - {0}
        return len(channels) >= max(1, found.channel_count) and schemas <= set(
            self.registry.schemas
        )

    @property
    def is_chunked(self) -> bool | None:
        """True if all messages lie in chunks; None if it does not say."""
        if self.statistics is None:
            return True if self.chunks else None
        unknown = not any(one.message_index_length for one in self.chunks)
        enough = unknown or self._indexed >= self.statistics.message_count
        return self.statistics.chunk_count > 0 and enough


def read_summary(stream: BinaryIO, size: int) -> Summary:
    """Return the summary section of a finished file.

    Raises:
        DamageError: The file does not end as a finished one does, or its summary is corrupt.
    """
    footer_at = size - _FOOTER_BYTES - len(MAGIC)
    if footer_at < len(MAGIC):
        raise DamageError("it was never finished")
    stream.seek(footer_at)
    end = stream.read()
    opcode, length = HEAD.unpack_from(end)
    if not end.endswith(MAGIC) or opcode != Opcode.FOOTER or length != 20:
        raise DamageError("it was never finished, or its end is damaged")
    footer = container.parse(Footer.read, end[HEAD.size : _FOOTER_BYTES])
    start = footer.summary_start or footer_at
    if not len(MAGIC) + DATA_END_BYTES <= start <= footer_at:
        raise DamageError("its footer is corrupt")
    stream.seek(start)
    section = stream.read(size - len(MAGIC) - 4 - start)
    if footer.summary_crc and zlib.crc32(section) != footer.summary_crc:
        raise DamageError("its summary's checksum is wrong")
    proved = footer.summary_crc != 0
    stream.seek(start - DATA_END_BYTES)
    has_end = _is_like_a_data_end(stream.read(HEAD.size))
    data_end = start - DATA_END_BYTES if has_end else start
    summary = Summary(Registry(), None, [], {}, data_end, proved, has_end)
    stream.seek(start)
    for _, record in container.records(stream, size):
        if record.opcode in _OF_DATA:
            raise DamageError("its footer is corrupt")
        summary.registry.take(record, lenient=proved)
        if record.opcode == Opcode.STATISTICS:
            summary = summary._replace(statistics=container.parse(Statistics.read, record.body))
        elif record.opcode == Opcode.CHUNK_INDEX:
            chunk = container.parse(ChunkIndex.read, record.body)
            summary.chunks.append(chunk)
            place = Place(Opcode.CHUNK, chunk.chunk_length)
            summary.places[chunk.chunk_start_offset] = place
        elif (opcode := _PLACED.get(record.opcode)) is not None:
            if len(record.body) < _PLACE.size:
                raise DamageError("an index is too short")
            offset, length = _PLACE.unpack_from(record.body)
            summary.places[offset] = Place(opcode, length)
    return summary


def _is_like_a_data_end(head: bytes) -> bool:
    """Return True for the head of the record that ends the data, also with a few wrong bits."""
    wrong = int.from_bytes(head, "little") ^ int.from_bytes(
        HEAD.pack(Opcode.DATA_END, 4), "little"
    )
    return wrong.bit_count() <= _WRONG_BITS


def indexed_times(stream: BinaryIO, chunk: ChunkIndex) -> list[int]:
    """Return the log times of a chunk's messages in recorded order, ns.

    They come from the message indexes behind the chunk, or from the chunk if it has none.

    Raises:
        DamageError: The indexes or the chunk are corrupt.
    """
    stream.seek(chunk.chunk_start_offset)
    head = stream.read(HEAD.size)
    opcode, length = HEAD.unpack(head) if len(head) == HEAD.size else (0, 0)
    if opcode != Opcode.CHUNK or length > container.MAX_RECORD_BYTES:
        raise DamageError("its index names a chunk where there is none")
    if not chunk.message_index_offsets:
        items = container.chunk_records(stream.read(length))
        return [container.log_time_of(one.body) for one in items if one.opcode == Opcode.MESSAGE]
    entries: list[tuple[int, int]] = []
    for offset in chunk.message_index_offsets.values():
        stream.seek(offset)
        body = stream.read(_MESSAGE_INDEX_BYTES)
        if len(body) < _MESSAGE_INDEX_BYTES or body[0] != Opcode.MESSAGE_INDEX:
            raise DamageError("its index names a message index where there is none")
        size = int.from_bytes(body[-4:], "little")
        found = stream.read(min(size, chunk.message_index_length))
        entries += container.ENTRY.iter_unpack(found[: len(found) // _ENTRY_BYTES * _ENTRY_BYTES])
    return [time for time, _ in sorted(entries, key=lambda entry: entry[1])]
