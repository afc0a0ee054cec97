"""The MCAP container, read with bounds: whatever the bytes are, an error is all they can cause.

Record layouts come from the ``mcap`` package; framing and messages are parsed here, because its
stream reader accepts short reads, trusts announced sizes and needs about ten times as long.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple, TypeVar

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Footer, Metadata, Schema, Statistics

from bicycle_bag.errors import BagError
from bicycle_bag.metadata import Topic
from bicycle_bag.qos import parse_profiles

MAGIC = b"\x89MCAP0\r\n"
# Larger than any record that a recorder writes, small enough for any machine.
MAX_RECORD_BYTES = 256 * 2**20

_T = TypeVar("_T")
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_CHUNK_INDEX = struct.Struct("<QQQQ")
_FOOTER_BYTES = _HEAD.size + 20


class DamageError(Exception):
    """Bytes that are not what the MCAP format says; ``str()`` says what is wrong."""


class Record(NamedTuple):
    """One record as it lies in the file or in a chunk."""

    opcode: int
    body: bytes


class RawMessage(NamedTuple):
    """One message as recorded; times in nanoseconds."""

    channel_id: int
    log_time_ns: int
    publish_time_ns: int
    data: bytes


class Registry:
    """Channels and schemas seen so far in a file, by number."""

    def __init__(self) -> None:
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}

    def take(self, record: Record) -> None:
        """Note the record if it defines a channel or a schema."""
        if record.opcode == Opcode.CHANNEL:
            channel = parse_channel(record.body)
            self.channels[channel.id] = channel
        elif record.opcode == Opcode.SCHEMA:
            schema = parse_schema(record.body)
            self.schemas[schema.id] = schema

    def type_of(self, channel: Channel) -> str:
        """The message type of a channel; empty if the file does not say."""
        schema = self.schemas.get(channel.schema_id)
        return schema.name if schema else ""

    def definition_of(self, channel: Channel) -> str:
        """The ``ros2msg`` text of a channel's type; empty if the file has none."""
        schema = self.schemas.get(channel.schema_id)
        written = schema is not None and schema.encoding == "ros2msg"
        return schema.data.decode(errors="replace") if schema and written else ""

    def topic_of(self, channel: Channel) -> Topic:
        """The topic that a channel holds."""
        return Topic(
            name=channel.topic,
            type=self.type_of(channel),
            qos=parse_profiles(channel.metadata.get("offered_qos_profiles", "")),
            type_hash=channel.metadata.get("topic_type_hash", ""),
            serialization_format=channel.message_encoding,
        )


def check_magic(path: Path, stream: BinaryIO) -> None:
    """Place ``stream`` behind the leading magic bytes.

    Raises:
        BagError: The file is of another kind.
        DamageError: The file ends within the magic bytes.
    """
    start = stream.read(len(MAGIC))
    if not MAGIC.startswith(start):
        raise BagError(f"{path} is not an MCAP file: name a bag directory or a .mcap file")
    if len(start) < len(MAGIC):
        raise DamageError("it ends before its first record")


def records(stream: BinaryIO, size: int) -> Iterator[tuple[int, Record]]:
    """Top-level records from the present position to the footer, each with its offset.

    Args:
        stream: File placed at a record.
        size: Bytes of the whole file.

    Raises:
        DamageError: A record is cut off, or the file ends without a footer.
    """
    offset = stream.tell()
    while True:
        head = stream.read(_HEAD.size)
        if len(head) < _HEAD.size:
            raise DamageError(f"it is cut off at byte {offset}")
        opcode, length = _HEAD.unpack(head)
        end = offset + _HEAD.size + length
        if end > size or length > MAX_RECORD_BYTES:
            raise DamageError(f"it is cut off or corrupt in the record at byte {offset}")
        yield offset, Record(opcode, stream.read(length))
        if opcode == Opcode.FOOTER:
            if stream.read(len(MAGIC)) != MAGIC:
                raise DamageError("it is cut off after its footer")
            return
        offset = end


def chunk_records(body: bytes) -> Iterator[Record]:
    """The records in a chunk, its checksum verified before the first comes out.

    Raises:
        DamageError: The chunk cannot be unpacked or its contents are not records.
    """
    content = _unpack(body)
    view = memoryview(content)
    offset, size = 0, len(content)
    while offset < size:
        if offset + _HEAD.size > size:
            raise DamageError("a chunk ends within a record")
        opcode, length = _HEAD.unpack_from(content, offset)
        offset += _HEAD.size
        if offset + length > size:
            raise DamageError("a chunk ends within a record")
        yield Record(opcode, bytes(view[offset : offset + length]))
        offset += length


def _unpack(body: bytes) -> bytes:
    chunk: Chunk = _parse(Chunk.read, body)
    size = chunk.uncompressed_size
    if size > MAX_RECORD_BYTES:
        raise DamageError(f"a chunk announces {size} bytes, over the limit of {MAX_RECORD_BYTES}")
    try:
        if chunk.compression == "zstd":
            content = _unpack_zstd(chunk.data, size)
        elif chunk.compression == "lz4":
            content = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
        elif chunk.compression == "":
            content = chunk.data
        else:
            raise DamageError(f"a chunk is packed as {chunk.compression!r}, not zstd or lz4")
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        raise DamageError(f"a chunk cannot be unpacked ({error})") from None
    if len(content) != size:
        raise DamageError(f"a chunk holds {len(content)} bytes instead of {size}")
    if chunk.uncompressed_crc and zlib.crc32(content) != chunk.uncompressed_crc:
        raise DamageError("a chunk's checksum is wrong")
    return content


def _unpack_zstd(data: bytes, size: int) -> bytes:
    # The frame announces a size of its own, and the library would reserve it.
    announced = zstandard.frame_content_size(data)
    if announced > size:
        raise DamageError(f"a chunk holds {announced} bytes instead of {size}")
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)


def parse_message(body: bytes) -> RawMessage:
    """A message record.

    Raises:
        DamageError: The record is too short.
    """
    if len(body) < _MESSAGE.size:
        raise DamageError("a message record is too short")
    channel_id, _, log_time, publish_time = _MESSAGE.unpack_from(body)
    return RawMessage(channel_id, log_time, publish_time, body[_MESSAGE.size :])


def parse_channel(body: bytes) -> Channel:
    """A channel record; ``DamageError`` if it is none."""
    return _parse(Channel.read, body)


def parse_schema(body: bytes) -> Schema:
    """A schema record; ``DamageError`` if it is none."""
    return _parse(Schema.read, body)


def parse_metadata(body: bytes) -> Metadata:
    """A metadata record; ``DamageError`` if it is none."""
    return _parse(Metadata.read, body)


def _parse(read: Callable[[ReadDataStream], _T], body: bytes) -> _T:
    try:
        return read(_Strict(body))
    except (McapError, UnicodeDecodeError, struct.error) as error:
        kind = read.__qualname__.split(".")[0].lower()
        raise DamageError(f"a {kind} record is corrupt ({error})") from None


class _Strict(ReadDataStream):
    """The package's stream, but to read more than there is is an error, however much."""

    def __init__(self, body: bytes) -> None:
        super().__init__(BytesIO(body))
        self._left = len(body)

    def read(self, length: int) -> bytes:
        if length > self._left:
            raise McapError("it ends too soon")
        self._left -= length
        return super().read(length)


class ChunkEntry(NamedTuple):
    """What the index of a finished file says of a chunk; times in ns, lengths in bytes."""

    start_ns: int
    end_ns: int
    offset: int
    length: int


class Summary(NamedTuple):
    """What the end of a finished file says of it; ``statistics`` may be missing."""

    registry: Registry
    statistics: Statistics | None
    chunks: list[ChunkEntry]


def read_summary(stream: BinaryIO, size: int) -> Summary:
    """The summary section of a finished file.

    Raises:
        DamageError: The file does not end as a finished one does, or its summary is corrupt.
    """
    tail = _FOOTER_BYTES + len(MAGIC)
    if size < len(MAGIC) + tail:
        raise DamageError("it was never finished")
    stream.seek(size - tail)
    end = stream.read(tail)
    opcode, length = _HEAD.unpack_from(end)
    if not end.endswith(MAGIC) or opcode != Opcode.FOOTER or length != 20:
        raise DamageError("it was never finished")
    footer: Footer = _parse(Footer.read, end[_HEAD.size : _FOOTER_BYTES])
    summary = Summary(Registry(), None, [])
    if footer.summary_start == 0:
        return summary
    if not len(MAGIC) <= footer.summary_start <= size - tail:
        raise DamageError("its footer is corrupt")
    stream.seek(footer.summary_start)
    section = stream.read(size - len(MAGIC) - 4 - footer.summary_start)
    if footer.summary_crc and zlib.crc32(section) != footer.summary_crc:
        raise DamageError("its summary's checksum is wrong")
    stream.seek(footer.summary_start)
    for _, record in records(stream, size):
        summary.registry.take(record)
        if record.opcode == Opcode.STATISTICS:
            summary = summary._replace(statistics=_parse(Statistics.read, record.body))
        elif record.opcode == Opcode.CHUNK_INDEX:
            if len(record.body) < _CHUNK_INDEX.size:
                raise DamageError("a chunk index is too short")
            summary.chunks.append(ChunkEntry(*_CHUNK_INDEX.unpack_from(record.body)))
    return summary


def size_of(path: Path) -> int:
    """Bytes of a file; ``BagError`` if it cannot be asked."""
    try:
        return path.stat().st_size
    except OSError as error:
        raise BagError(f"cannot read {path} ({error.strerror}): check path and rights") from None


def open_binary(path: Path) -> BinaryIO:
    """A file to read from; ``BagError`` if it cannot be opened."""
    try:
        return path.open("rb")
    except OSError as error:
        raise BagError(f"cannot read {path} ({error.strerror}): check path and rights") from None
