"""The container's bounds, record by record: what is refused, and in which words."""

from __future__ import annotations

import struct
import zlib
from io import BytesIO
from pathlib import Path

import lz4.frame  # type: ignore[import-untyped]
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema

from bicycle_bag.container import (
    ENTRY,
    HEAD,
    MAGIC,
    MAX_RECORD_BYTES,
    DamageError,
    Record,
    Registry,
    channel_of,
    check_magic,
    chunk_records,
    message_index,
    open_binary,
    parse_channel,
    parse_chunk,
    parse_message,
    records,
    size_of,
    unpack,
)
from bicycle_bag.errors import BagError
from bicycle_bag.metadata import Topic

PLAIN = bytes(range(200)) * 3
PATH = Path("some.mcap")


def framed(opcode: int, body: bytes) -> bytes:
    return HEAD.pack(opcode, len(body)) + body


def chunk(compression: str = "", size: int | None = None, crc: int | None = None) -> Chunk:
    """Return a chunk that holds PLAIN, and announces so many bytes and such a checksum."""
    packed = {
        "": PLAIN,
        "lz4": lz4.frame.compress(PLAIN),
        "zstd": zstandard.compress(PLAIN),
    }.get(compression, PLAIN)
    size = len(PLAIN) if size is None else size
    crc = zlib.crc32(PLAIN) if crc is None else crc
    return Chunk(compression, packed, 0, 0, crc, size)


@pytest.mark.parametrize("wrong", [0, 1, 2])
def test_one_or_two_wrong_bytes_of_the_magic_are_damage(wrong: int) -> None:
    start = bytearray(MAGIC)
    for index in range(wrong):
        start[2 * index] ^= 4
    stream = BytesIO(bytes(start) + b"rest")
    if wrong:
        with pytest.raises(DamageError, match="its first bytes are wrong"):
            check_magic(PATH, stream)
    else:
        check_magic(PATH, stream)
        assert stream.read() == b"rest"


@pytest.mark.parametrize(
    "start", [b"\x89MXXX0\r\n", b"%PDF-1.7", b"X", b"abc", b"\x89MXYZ"], ids=repr
)
def test_more_wrong_bytes_are_another_kind_of_file(start: bytes) -> None:
    with pytest.raises(BagError, match=r"some\.mcap is not an MCAP file: name a bag directory"):
        check_magic(PATH, BytesIO(start))


@pytest.mark.parametrize("length", range(8))
def test_a_file_that_ends_in_its_magic_is_damaged(length: int) -> None:
    with pytest.raises(DamageError, match="it ends before its first record"):
        check_magic(PATH, BytesIO(MAGIC[:length]))


def test_records_come_with_their_places_to_the_footer() -> None:
    parts = [framed(Opcode.HEADER, b"abc"), framed(Opcode.CHANNEL, b""), framed(200, b"x" * 50)]
    data = MAGIC + b"".join(parts) + framed(Opcode.FOOTER, bytes(20)) + MAGIC
    stream = BytesIO(data)
    stream.seek(len(MAGIC))
    found = list(records(stream, len(data)))
    assert [(place, one.opcode, len(one.body)) for place, one in found] == [
        (8, Opcode.HEADER, 3),
        (20, Opcode.CHANNEL, 0),
        (29, 200, 50),
        (88, Opcode.FOOTER, 20),
    ]


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "cut off at byte 0"),
        (framed(1, b"ab") + b"\0" * 8, "cut off at byte 11"),
        (framed(1, b"ab")[:-1], "cut off or corrupt in the record at byte 0"),
        (framed(1, b"ab") + HEAD.pack(3, 1), "cut off or corrupt in the record at byte 11"),
        (framed(2, b"ab"), "cut off after its footer"),
        (framed(2, b"ab") + MAGIC[:-1] + b"x", "cut off after its footer"),
    ],
)
def test_records_that_are_cut_off_are_damage(data: bytes, said: str) -> None:
    with pytest.raises(DamageError, match=said):
        list(records(BytesIO(data), len(data)))


def test_a_record_has_256_mib_at_most() -> None:
    assert MAX_RECORD_BYTES == 268_435_456
    huge = HEAD.pack(1, MAX_RECORD_BYTES + 1)
    with pytest.raises(DamageError, match="corrupt in the record at byte 0"):
        next(records(BytesIO(huge), 2 * MAX_RECORD_BYTES))
    largest = HEAD.pack(1, MAX_RECORD_BYTES)
    assert next(records(BytesIO(largest), 2 * MAX_RECORD_BYTES))[0] == 0


@pytest.mark.parametrize("compression", ["", "lz4", "zstd"])
def test_a_chunk_is_unpacked(compression: str) -> None:
    content = unpack(chunk(compression))
    assert content.plain == PLAIN
    assert (content.compression, content.has_checksum) == (compression, True)
    without = unpack(chunk(compression, crc=0))
    assert (without.plain, without.has_checksum) == (PLAIN, False)


@pytest.mark.parametrize("compression", ["", "lz4", "zstd"])
def test_a_chunk_with_a_wrong_checksum_is_damage(compression: str) -> None:
    for crc in (1, zlib.crc32(PLAIN) + 1, zlib.crc32(PLAIN) - 1):
        with pytest.raises(DamageError, match="a chunk's checksum is wrong"):
            unpack(chunk(compression, crc=crc))


@pytest.mark.parametrize(
    ("compression", "size", "said"),
    [
        ("", 599, "holds 600 bytes instead of 599"),
        ("", 601, "holds 600 bytes instead of 601"),
        ("lz4", 590, "holds 591 bytes instead of 590"),
        ("lz4", 601, "holds 600 bytes instead of 601"),
        ("zstd", 599, "holds 600 bytes instead of 599"),
        ("zstd", 601, "holds 600 bytes instead of 601"),
        ("zip", 600, "packed as 'zip', not zstd or lz4"),
        ("zst", 600, "packed as 'zst', not zstd or lz4"),
        ("ZSTD", 600, "packed as 'ZSTD', not zstd or lz4"),
        ("", MAX_RECORD_BYTES + 1, "announces 268435457 bytes, over the limit of 268435456"),
        ("", MAX_RECORD_BYTES, "holds 600 bytes instead of 268435456"),
    ],
)
def test_a_chunk_of_another_size_or_packing_is_damage(
    compression: str, size: int, said: str
) -> None:
    with pytest.raises(DamageError, match=said):
        unpack(chunk(compression, size))


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
def test_a_chunk_that_is_not_packed_so_is_damage(compression: str) -> None:
    with pytest.raises(DamageError, match="a chunk cannot be unpacked"):
        unpack(Chunk(compression, b"no frame", 0, 0, 0, 8))


def in_chunk(plain: bytes) -> bytes:
    """Return the body of a chunk record."""
    head = struct.pack("<QQQI", 0, 0, len(plain), 0)
    return head + struct.pack("<I", 0) + struct.pack("<Q", len(plain)) + plain


def test_a_chunks_records_come_in_order() -> None:
    parts = [(Opcode.MESSAGE, b"m" * 30), (Opcode.SCHEMA, b""), (Opcode.MESSAGE, b"n" * 22)]
    body = in_chunk(b"".join(framed(*part) for part in parts))
    assert list(chunk_records(body)) == [Record(*part) for part in parts]
    content = unpack(parse_chunk(body))
    assert [place for place, _ in content.records()] == [0, 39, 48]


@pytest.mark.parametrize("cut", [1, 5, 9, 20])
def test_a_chunk_that_ends_within_a_record_is_damage(cut: int) -> None:
    plain = framed(Opcode.MESSAGE, b"m" * 11) + framed(Opcode.MESSAGE, b"n" * 12)[:cut]
    found = chunk_records(in_chunk(plain))
    assert next(found).body == b"m" * 11
    with pytest.raises(DamageError, match="a chunk ends within a record"):
        next(found)


def test_a_record_must_fill_a_chunk_but_may_be_longer_elsewhere() -> None:
    with pytest.raises(DamageError, match=r"a chunk record is corrupt .there is more behind it"):
        parse_chunk(in_chunk(b"") + b"x")
    body = struct.pack("<HH", 7, 0) + struct.pack("<I", 1) + b"t" + struct.pack("<I", 3) + b"cdr"
    body += struct.pack("<I", 0)
    assert parse_channel(body).topic == "t"
    assert parse_channel(body + b"of a later version").message_encoding == "cdr"
    with pytest.raises(DamageError, match=r"a channel record is corrupt .it ends too soon"):
        parse_channel(body[:-1])


def message(channel: int, sequence: int, log: int, publish: int, data: bytes) -> bytes:
    return struct.pack("<HIQQ", channel, sequence, log, publish) + data


def test_a_message_is_its_channel_times_and_bytes() -> None:
    body = message(515, 9, 7, 8, b"data")
    assert parse_message(body) == (515, 7, 8, b"data")
    assert parse_message(body[:22]) == (515, 7, 8, b"")
    assert channel_of(body) == 515
    with pytest.raises(DamageError, match="a message record is too short"):
        parse_message(body[:21])


def test_an_index_has_time_and_place_of_each_message_of_a_channel() -> None:
    items = [
        Record(Opcode.CHANNEL, b"12345"),
        Record(Opcode.MESSAGE, message(1, 0, 70, 0, b"abc")),
        Record(Opcode.MESSAGE, message(2, 0, 60, 0, b"")),
        Record(Opcode.MESSAGE, message(1, 0, 50, 0, b"")),
    ]
    assert message_index(items) == {
        1: ENTRY.pack(70, 14) + ENTRY.pack(50, 14 + 34 + 31),
        2: ENTRY.pack(60, 14 + 34),
    }


def test_a_registry_knows_types_and_definitions_of_ros_only() -> None:
    registry = Registry()
    assert (registry.channels, registry.schemas) == ({}, {})
    registry.schemas[1] = Schema(1, b"int8 a \xff\n", "ros2msg", "x/msg/A")
    registry.schemas[2] = Schema(2, b"{}", "jsonschema", "plot")
    ours = Channel(5, "/a", "cdr", {"topic_type_hash": "RIHS01_1"}, 1)
    plot, bare = Channel(6, "/b", "json", {}, 2), Channel(7, "/c", "cdr", {}, 9)
    assert [registry.type_of(one) for one in (ours, plot, bare)] == ["x/msg/A", "plot", ""]
    assert registry.definition_of(ours) == "int8 a \ufffd\n"
    assert [registry.definition_of(one) for one in (plot, bare)] == ["", ""]
    assert registry.topic_of(ours) == Topic("/a", "x/msg/A", (), "RIHS01_1")
    assert registry.topic_of(plot) == Topic("/b", "plot", (), "", "json")


def test_what_cannot_be_opened_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"12345")
    assert size_of(tmp_path / "file") == 5
    with open_binary(tmp_path / "file") as stream:
        assert stream.read() == b"12345"
    for ask in (size_of, open_binary):
        with pytest.raises(BagError, match=r"No such file or directory.: check path and rights"):
            ask(tmp_path / "none")
