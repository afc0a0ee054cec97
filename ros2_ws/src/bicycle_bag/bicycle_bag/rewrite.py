"""Writes a finished MCAP file out of the pieces of another, each as it was.

Chunks stay as they were packed, or are packed where they were not; attachments, metadata, private
records, channels and schemas are copied byte by byte. Only indexes, statistics and checksums are
made anew.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterable
from pathlib import Path

import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Statistics,
    SummaryOffset,
)

from bicycle_bag import container
from bicycle_bag.container import ENTRY, HEAD, LIBRARY, MAGIC, Registry, message_index
from bicycle_bag.walk import Piece

_BLOCK = 2**20
_CHUNK = struct.Struct("<QQQI")


class Rewrite:
    """One file in the making.

    Args:
        source: The file that the pieces are of.
        target: File to create.
        registry: The source's channels and schemas, complete for each piece that is added.

    Attributes:
        counts: Messages so far, by channel.
        span: Their first and last log time in ns; None before there is one.

    Raises:
        OSError: The disk does not take it; also from the other methods.
    """

    def __init__(self, source: Path, target: Path, registry: Registry) -> None:
        self._source = source.open("rb")
        self._out = target.open("xb")
        self._registry = registry
        self._checksum = 0
        self._defined: set[int] = set()
        self.counts: dict[int, int] = {}
        self.span: tuple[int, int] | None = None
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._write(MAGIC)

    def add(self, piece: Piece) -> None:
        """Append a piece; what is made anew at the end is left out."""
        if self._out.tell() == len(MAGIC) and piece.opcode != Opcode.HEADER:
            self._write(_bytes([Header("ros2", LIBRARY)]))
        if piece.content is not None:
            self._add_chunk(piece)
        elif piece.opcode == Opcode.MESSAGE:
            for item in piece.items:
                message = container.parse_message(item.body)
                self._define({message.channel_id})
                self._count(message.channel_id, 1, (message.log_time_ns, message.log_time_ns))
                self._write(HEAD.pack(item.opcode, len(item.body)) + item.body)
        elif piece.opcode not in (Opcode.MESSAGE_INDEX, Opcode.DATA_END):
            offset = self._copy(piece)
            length = piece.end - piece.offset
            if piece.opcode == Opcode.CHANNEL:
                self._defined.add(container.parse_channel(piece.body).id)
            elif piece.opcode == Opcode.METADATA:
                name = container.parse_metadata(piece.body).name
                self._metadata.append(MetadataIndex(offset, length, name))
            elif piece.opcode == Opcode.ATTACHMENT:
                self._attachments.append(self._attachment_index(piece, offset))

    def add_metadata(self, name: str, content: dict[str, str]) -> None:
        """Append a metadata record."""
        data = _bytes([Metadata(name, content)])
        self._metadata.append(MetadataIndex(self._out.tell(), len(data), name))
        self._write(data)

    def finish(self) -> None:
        """Write index and footer, and wait until the disk has all."""
        if self._out.tell() == len(MAGIC):
            self._write(_bytes([Header("ros2", LIBRARY)]))
        self._write(_bytes([DataEnd(self._checksum)]))
        start = self._out.tell()
        statistics = Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._registry.channels),
            channel_message_counts=self.counts,
            chunk_count=len(self._chunks),
            message_count=sum(self.counts.values()),
            message_end_time=self.span[1] if self.span else 0,
            message_start_time=self.span[0] if self.span else 0,
            metadata_count=len(self._metadata),
            schema_count=len(self._registry.schemas),
        )
        groups: list[tuple[int, Iterable[McapRecord]]] = [
            (Opcode.SCHEMA, self._registry.schemas.values()),
            (Opcode.CHANNEL, self._registry.channels.values()),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, self._attachments),
            (Opcode.METADATA_INDEX, self._metadata),
        ]
        summary, offsets = b"", []
        for opcode, group in groups:
            data = _bytes(group)
            if data:
                offsets.append(SummaryOffset(opcode, start + len(summary), len(data)))
            summary += data
        offsets_start = start + len(summary)
        summary += _bytes(offsets)
        footer = _bytes([Footer(start, offsets_start, 0)])[:-4]
        checksum = zlib.crc32(summary + footer)
        self._write(summary + footer + checksum.to_bytes(4, "little") + MAGIC)
        self._out.flush()
        os.fsync(self._out.fileno())

    def close(self) -> None:
        """Close both files."""
        self._source.close()
        self._out.close()

    def _add_chunk(self, piece: Piece) -> None:
        assert piece.content is not None
        compression, packed, plain, _ = piece.content
        index = message_index(piece.items)
        defining = (item.body for item in piece.items if item.opcode == Opcode.CHANNEL)
        inside = {container.channel_of(body) for body in defining}
        if sum(HEAD.size + len(item.body) for item in piece.items) < len(plain):
            # Messages that belong to no channel were left out.
            plain = b"".join(HEAD.pack(code, len(body)) + body for code, body in piece.items)
            compression = ""
        if not compression:  # a repair may have to do with the last of the disk
            compression, packed = "zstd", zstandard.compress(plain)
        self._define(set(index) - inside)
        self._defined |= inside
        times = [time for entries in index.values() for time, _ in ENTRY.iter_unpack(entries)]
        span = min(times, default=0), max(times, default=0)
        for channel, entries in index.items():
            self._count(channel, len(entries) // ENTRY.size, span)
        self._write_chunk(span, compression, packed, plain, index)

    def _write_chunk(
        self,
        span: tuple[int, int],
        compression: str,
        packed: bytes,
        plain: bytes,
        index: dict[int, bytearray],
    ) -> None:
        name = compression.encode()
        head = _CHUNK.pack(*span, len(plain), zlib.crc32(plain))
        head += len(name).to_bytes(4, "little") + name + len(packed).to_bytes(8, "little")
        start = self._out.tell()
        self._write(HEAD.pack(Opcode.CHUNK, len(head) + len(packed)) + head + packed)
        end = self._out.tell()
        places: dict[int, int] = {}
        for channel, entries in index.items():
            places[channel] = self._out.tell()
            body = struct.pack("<HI", channel, len(entries)) + entries
            self._write(HEAD.pack(Opcode.MESSAGE_INDEX, len(body)) + body)
        self._chunks.append(
            ChunkIndex(
                chunk_length=end - start,
                chunk_start_offset=start,
                compression=compression,
                compressed_size=len(packed),
                message_end_time=span[1],
                message_index_length=self._out.tell() - end,
                message_index_offsets=places,
                message_start_time=span[0],
                uncompressed_size=len(plain),
            )
        )

    def _count(self, channel: int, messages: int, span: tuple[int, int]) -> None:
        self.counts[channel] = self.counts.get(channel, 0) + messages
        ends = *(self.span or ()), *span
        self.span = min(ends), max(ends)

    def _define(self, channels: set[int]) -> None:
        """Write those channels, with their schemas, whose own records are lost."""
        for number in sorted(channels - self._defined):
            channel = self._registry.channels[number]
            schema = self._registry.schemas.get(channel.schema_id)
            self._write(_bytes([*([schema] if schema else ()), channel]))
        self._defined |= channels

    def _attachment_index(self, piece: Piece, offset: int) -> AttachmentIndex:
        self._source.seek(piece.offset + HEAD.size)
        head = ReadDataStream(self._source)
        log_time, create_time = head.read8(), head.read8()
        name, media_type = head.read_prefixed_string(), head.read_prefixed_string()
        length = piece.end - piece.offset
        return AttachmentIndex(
            offset, length, log_time, create_time, head.read8(), name, media_type
        )

    def _copy(self, piece: Piece) -> int:
        """Copy a record; returns where it lies now."""
        offset = self._out.tell()
        self._write(HEAD.pack(piece.opcode, piece.end - piece.offset - HEAD.size))
        for at in range(piece.offset + HEAD.size, piece.end, _BLOCK):
            self._source.seek(at)
            self._write(self._source.read(min(_BLOCK, piece.end - at)))
        return offset

    def _write(self, data: bytes) -> None:
        self._checksum = zlib.crc32(data, self._checksum)
        self._out.write(data)


def _bytes(records: Iterable[McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]
