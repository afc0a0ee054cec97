"""The MCAP container, read with bounds: whatever the bytes are, an error is all they can cause.

Record layouts come from the `mcap` package; framing and messages are parsed here, because its
stream reader accepts short reads, trusts announced sizes and needs about ten times as long.
"""

from __future__ import annotations

import contextlib
import re
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple, TypeVar

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata, Schema

from bicycle_bag.errors import BagError
from bicycle_bag.metadata import Topic
from bicycle_bag.qos import parse_profiles

MAGIC = b"\x89MCAP0\r\n"
SQLITE = b"SQLite format 3"[: len(MAGIC)]
"""First bytes of a file of rosbag2's other storage."""
CONVERT = (
    "record.sh --repair makes one of it, as ros2 bag convert does on a machine that has ROS 2"
)
"""Advice to the user of such a bag."""
MAX_RECORD_BYTES = 256 * 2**20
"""Limit of a record: larger than any that a recorder writes, small enough for any machine."""

MOST_DEFINING = 16 * 2**20
"""Bytes of a damaged chunk in which definitions are looked for."""
LIBRARY = "bicycle_bag"
"""Name of this package in the files that it writes."""
_PIECE = 4096
"""Bytes; what a damaged packing gives is lost from the piece with the damage on."""

_LZ4_FRAME = b"\x04\x22\x4d\x18"
_DEFINITION = re.compile(rb"[\x03\x04].{3}\0{5}", re.DOTALL)
"""Pattern at which a channel or a schema of less than 16 MiB may begin."""
_PATIENCE = 300
"""Largest number of such places without one: bounds the work on bytes made to deceive."""
_T = TypeVar("_T")
HEAD = struct.Struct("<BQ")
ENTRY = struct.Struct("<QQ")
_MESSAGE = struct.Struct("<HIQQ")


class DamageError(Exception):
    """Bytes that violate the MCAP format; `str()` says how."""


class Record(NamedTuple):
    """A record as it lies in the file or in a chunk."""

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

    def take(self, record: Record, lenient: bool = False) -> None:
        """Note the record if it defines a channel or a schema.

        Args:
            record: Any record.
            lenient: Spell out bytes of a text that are not UTF-8: a checksum proves them.

        Raises:
            DamageError: It is of such a kind, and corrupt.
        """
        if record.opcode == Opcode.CHANNEL:
            channel = parse(Channel.read, record.body, lenient=lenient)
            self.channels[channel.id] = channel
        elif record.opcode == Opcode.SCHEMA:
            schema = parse(Schema.read, record.body, lenient=lenient)
            self.schemas[schema.id] = schema

    def type_of(self, channel: Channel) -> str:
        """Return the message type of a channel; empty if the file does not say."""
        schema = self.schemas.get(channel.schema_id)
        return schema.name if schema else ""

    def definition_of(self, channel: Channel) -> str:
        """Return the `ros2msg` text of a channel's type; empty if the file has none."""
        schema = self.schemas.get(channel.schema_id)
        written = schema is not None and schema.encoding == "ros2msg"
        return schema.data.decode(errors="replace") if schema and written else ""

    def topic_of(self, channel: Channel) -> Topic:
        """Return the topic that a channel holds."""
        return Topic(
            name=channel.topic,
            type=self.type_of(channel),
            qos=parse_profiles(channel.metadata.get("offered_qos_profiles", "")),
            type_hash=channel.metadata.get("topic_type_hash", ""),
            serialization_format=channel.message_encoding,
        )


def check_magic(path: Path, stream: BinaryIO) -> None:
    """Place `stream` behind the leading magic bytes.

    Raises:
        BagError: The file is of another kind.
        DamageError: The file ends within the magic bytes, or one or two of them are wrong.
    """
    start = stream.read(len(MAGIC))
    wrong = sum(one != other for one, other in zip(start, MAGIC, strict=False))
    if start == SQLITE:
        raise BagError(f"{path} is stored as sqlite3, and only mcap can be read here: {CONVERT}")
    if wrong > 2 or wrong == len(start) > 0:
        raise BagError(f"{path} is not an MCAP file: name a bag directory or a .mcap file")
    if len(start) < len(MAGIC):
        raise DamageError("it ends before its first record")
    if wrong:
        raise DamageError("its first bytes are wrong")


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
        head = stream.read(HEAD.size)
        if len(head) < HEAD.size:
            raise DamageError(f"it is cut off at byte {offset}")
        opcode, length = HEAD.unpack(head)
        end = offset + HEAD.size + length
        if end > size or length > MAX_RECORD_BYTES:
            raise DamageError(f"it is cut off or corrupt in the record at byte {offset}")
        yield offset, Record(opcode, stream.read(length))
        if opcode == Opcode.FOOTER:
            if stream.read(len(MAGIC)) != MAGIC:
                raise DamageError("it is cut off after its footer")
            return
        offset = end


class Content(NamedTuple):
    """A chunk's records as they lie in it, and as they were packed into it."""

    compression: str
    packed: bytes
    plain: bytes
    has_checksum: bool

    def holds_more_than(self, most: int) -> bool:
        """Return True if there are more records than so many, whatever they are."""
        offset, size = 0, len(self.plain)
        for _ in range(most if size > most * HEAD.size else 0):
            if offset + HEAD.size > size:
                return False
            offset += HEAD.size + HEAD.unpack_from(self.plain, offset)[1]
        return 0 < offset < size

    def records(self) -> Iterator[tuple[int, Record]]:
        """Yield each record with its offset in `plain`; `DamageError` if there is none."""
        view, offset, size = memoryview(self.plain), 0, len(self.plain)
        while offset < size:
            body = offset + HEAD.size
            opcode, length = HEAD.unpack_from(view, offset) if body <= size else (0, size)
            if body + length > size:
                raise DamageError("a chunk ends within a record")
            yield offset, Record(opcode, bytes(view[body : body + length]))
            offset = body + length


def chunk_records(body: bytes) -> Iterator[Record]:
    """Yield the records in a chunk after its checksum is verified.

    Raises:
        DamageError: The chunk cannot be unpacked or its contents are not records.
    """
    yield from (record for _, record in unpack(parse_chunk(body)).records())


def parse_chunk(body: bytes) -> Chunk:
    """Return a chunk record, still packed; `DamageError` if it is none."""
    return parse(Chunk.read, body, whole=True)


def unpack(chunk: Chunk) -> Content:
    """Return the contents of a chunk.

    Raises:
        DamageError: It cannot be unpacked, or its size or checksum is wrong.
    """
    size = chunk.uncompressed_size
    if size > MAX_RECORD_BYTES:
        raise DamageError(f"a chunk announces {size} bytes, over the limit of {MAX_RECORD_BYTES}")
    try:
        if chunk.compression == "zstd":
            plain = _unpack_zstd(chunk.data, size)
        elif chunk.compression == "lz4":
            plain = _unpack_lz4(chunk.data, size)
        elif chunk.compression == "":
            plain = chunk.data
        else:
            raise DamageError(f"a chunk is packed as {chunk.compression!r}, not zstd or lz4")
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        raise DamageError(f"a chunk cannot be unpacked ({error})") from None
    if len(plain) != size:
        raise DamageError(f"a chunk holds {len(plain)} bytes instead of {size}")
    if chunk.uncompressed_crc and zlib.crc32(plain) != chunk.uncompressed_crc:
        raise DamageError("a chunk's checksum is wrong")
    return Content(chunk.compression, chunk.data, plain, bool(chunk.uncompressed_crc))


def _unpack_zstd(data: bytes, size: int) -> bytes:
    # The frame announces a size of its own, and the library would reserve it.
    announced = zstandard.frame_content_size(data) if data else 0
    if announced > size:
        raise DamageError(f"a chunk holds {announced} bytes instead of {size}")
    if announced == size > 0:
        return bytes(zstandard.ZstdDecompressor().decompress(data, max_output_size=size))
    # Several frames, or one that does not announce its size.
    reading = zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True)
    with reading as stream:
        return bytes(stream.read(size + 1))


def _unpack_lz4(data: bytes, size: int) -> bytes:
    plain = b""
    while data and len(plain) <= size:
        if len(plain) == size > 0 and not data.startswith(_LZ4_FRAME):
            break  # as in zstd, what follows the frames is no part of them
        frame = lz4.frame.LZ4FrameDecompressor()
        plain += frame.decompress(data, max_length=size + 1 - len(plain))
        data = (frame.unused_data or b"") if frame.eof else b""
    return plain


def definitions_of_a_damaged_chunk(body: bytes) -> Registry:
    """Return the channels and schemas that can be read in a chunk before its damage.

    Nothing proves them: a flipped bit may lie in a name.
    """
    found = Registry()
    with contextlib.suppress(DamageError):
        chunk = parse_chunk(body)
        for _, record in Content("", b"", _beginning(chunk), False).records():
            found.take(record)
    return found


def definitions_of_a_damaged_summary(section: bytes) -> Registry:
    """Return the channels and schemas that can be read in a file's end, wherever it is damaged.

    Nothing proves them: a flipped bit may lie in a name.
    """
    found, offset, patience = Registry(), 0, _PATIENCE
    while patience and (match := _DEFINITION.search(section, offset)):
        body, length = match.start() + HEAD.size, HEAD.unpack_from(section, match.start())[1]
        offset = body + length
        try:
            if offset > len(section):
                raise DamageError("it ends too soon")
            found.take(Record(section[match.start()], section[body:offset]))
        except DamageError:
            offset, patience = match.start() + 1, patience - 1
    return found


def _beginning(chunk: Chunk) -> bytes:
    """Return the contents of a chunk, as far as they can be unpacked."""
    if chunk.compression != "zstd":
        return chunk.data[:MOST_DEFINING] if chunk.compression == "" else b""
    plain = b""
    with (
        contextlib.suppress(zstandard.ZstdError),
        zstandard.ZstdDecompressor().stream_reader(chunk.data) as stream,
    ):
        while len(plain) < MOST_DEFINING and (more := stream.read(_PIECE)):
            plain += more
    return plain


def message_index(items: Iterable[Record]) -> dict[int, bytearray]:
    """Return a chunk's message indexes by channel: log time and offset of each message."""
    index: dict[int, bytearray] = {}
    offset = 0
    for opcode, body in items:
        if opcode == Opcode.MESSAGE:
            channel, _, log_time, _ = _MESSAGE.unpack_from(body)
            index.setdefault(channel, bytearray()).extend(ENTRY.pack(log_time, offset))
        offset += HEAD.size + len(body)
    return index


def parse_message(body: bytes) -> RawMessage:
    """Return a message record.

    Raises:
        DamageError: The record is too short.
    """
    if len(body) < _MESSAGE.size:
        raise DamageError("a message record is too short")
    channel_id, _, log_time, publish_time = _MESSAGE.unpack_from(body)
    return RawMessage(channel_id, log_time, publish_time, body[_MESSAGE.size :])


def channel_of(body: bytes) -> int:
    """Return the channel of the record of a message or a channel."""
    return int.from_bytes(body[:2], "little")


def log_time_of(body: bytes) -> int:
    """Return the log time of a message record, ns."""
    return int.from_bytes(body[6:14], "little")


def parse_channel(body: bytes) -> Channel:
    """Return a channel record; `DamageError` if it is none."""
    return parse(Channel.read, body)


def parse_schema(body: bytes) -> Schema:
    """Return a schema record; `DamageError` if it is none."""
    return parse(Schema.read, body)


def parse_metadata(body: bytes) -> Metadata:
    """Return a metadata record; `DamageError` if it is none."""
    return parse(Metadata.read, body)


def parse(
    read: Callable[[ReadDataStream], _T], body: bytes, whole: bool = False, lenient: bool = False
) -> _T:
    """Return a record of the `mcap` package.

    Args:
        read: Its reader.
        body: Its bytes.
        whole: It must fill them; others may be followed by fields of a later version.
        lenient: Spell out bytes of a text that are not UTF-8.

    Raises:
        DamageError: It is none.
    """
    stream = _Lenient(body) if lenient else _Strict(body)
    try:
        found = read(stream)
        if whole and stream.count < len(body):
            raise McapError("there is more behind it")
        return found
    except (McapError, UnicodeDecodeError, struct.error) as error:
        kind = read.__qualname__.split(".")[0].lower()
        raise DamageError(f"a {kind} record is corrupt ({error})") from None


class _Strict(ReadDataStream):
    """A stream of the package that raises an error instead of reading past the end."""

    def __init__(self, body: bytes) -> None:
        super().__init__(BytesIO(body))
        self._left = len(body)

    def read(self, length: int) -> bytes:
        if length > self._left:
            raise McapError("it ends too soon")
        self._left -= length
        return super().read(length)


class _Lenient(_Strict):
    """A stream that reads texts which are not UTF-8."""

    def read_prefixed_string(self) -> str:
        return self.read(self.read4()).decode(errors="backslashreplace")


def size_of(path: Path) -> int:
    """Return the size of a file in bytes; `BagError` if it is unknown."""
    try:
        return path.stat().st_size
    except OSError as error:
        raise BagError(f"cannot read {path} ({error.strerror}): check path and rights") from None


def open_binary(path: Path) -> BinaryIO:
    """Open a file for reading; `BagError` if that fails."""
    try:
        return path.open("rb")
    except OSError as error:
        raise BagError(f"cannot read {path} ({error.strerror}): check path and rights") from None
