"""Files as the format allows them and hardly anybody writes them, byte by byte."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import lz4.frame  # type: ignore[import-untyped]
import pytest
import zstandard
from ride_bag import TYPES, make_bag, ride, schemas

from bicycle_bag import repair, walk
from bicycle_bag.container import HEAD, MAGIC
from bicycle_bag.errors import BagError
from bicycle_bag.reader import BagReader

NUMBERS = {topic: number for number, topic in enumerate(TYPES, 1)}
RIDE = ride(20)
FIRST, LAST = RIDE[0][2], RIDE[-1][2]
SKIPPED = struct.pack("<II", 0x184D2A50, 4) + b"abcd"


def record(opcode: int, body: bytes) -> bytes:
    return HEAD.pack(opcode, len(body)) + body


def text(content: str | bytes) -> bytes:
    data = content.encode() if isinstance(content, str) else content
    return struct.pack("<I", len(data)) + data


def channel(number: int, schema: int, topic: str | bytes) -> bytes:
    body = struct.pack("<HH", number, schema) + text(topic) + text("cdr") + text("")
    return record(4, body)


def schema(topic: str) -> bytes:
    kind = f"bicycle_msgs/msg/{TYPES[topic]}"
    body = struct.pack("<H", NUMBERS[topic]) + text(kind) + text("ros2msg")
    return record(3, body + text(schemas().definition(kind)))


DEFINED = b"".join(schema(topic) + channel(n, n, topic) for topic, n in NUMBERS.items())


def said(number: int = 0, log_ns: int = FIRST, data: bytes = b"") -> bytes:
    return record(5, struct.pack("<HIQQ", number, 0, log_ns, log_ns) + data)


MESSAGES = [said(NUMBERS[topic], now, data) for topic, data, now in RIDE]
BODY = b"".join(MESSAGES)


def chunk(plain: bytes, compression: str = "", packed: bytes | None = None) -> bytes:
    head = struct.pack("<QQQI", FIRST, LAST, len(plain), zlib.crc32(plain))
    packed = plain if packed is None else packed
    return record(6, head + text(compression) + struct.pack("<Q", len(packed)) + packed)


BEGIN = MAGIC + record(1, text("ros2") + text("x"))
FOOTER = record(2, struct.pack("<QQI", 0, 0, 0)) + MAGIC
END = record(15, struct.pack("<I", 0)) + FOOTER
ALL = DEFINED + BODY
HALF = len(RIDE) // 2
NOTHING = zstandard.ZstdCompressor(write_content_size=False).compress(b"")
UNUSUAL = {
    "messages outside chunks behind those inside": DEFINED
    + chunk(b"".join(MESSAGES[:HALF]))
    + b"".join(MESSAGES[HALF:])
    + END,
    "messages outside chunks before those inside": DEFINED
    + b"".join(MESSAGES[:HALF])
    + chunk(b"".join(MESSAGES[HALF:]))
    + END,
    "a record of a later version": record(0x20, b"future") + chunk(ALL) + END,
    "such a record between messages": DEFINED
    + b"".join(MESSAGES[:HALF])
    + record(0x55, b"future")
    + b"".join(MESSAGES[HALF:])
    + END,
    "two zstd frames": chunk(ALL, "zstd", zstandard.compress(DEFINED) + zstandard.compress(BODY))
    + END,
    "a skippable frame": chunk(ALL, "zstd", SKIPPED + zstandard.compress(ALL)) + END,
    "two lz4 frames": chunk(ALL, "lz4", lz4.frame.compress(DEFINED) + lz4.frame.compress(BODY))
    + END,
    "an empty zstd chunk": chunk(b"", "zstd", zstandard.compress(b"")) + chunk(ALL) + END,
    "an empty one of unknown size": chunk(b"", "zstd", NOTHING) + chunk(ALL) + END,
    "an empty one of no bytes": chunk(b"", "zstd") + chunk(ALL) + END,
    "an empty lz4 chunk": chunk(b"", "lz4", lz4.frame.compress(b"")) + chunk(ALL) + END,
    "a topic that is not UTF-8": chunk(channel(9, 1, b"/\xff\xfe") + ALL) + END,
    "no end of data": chunk(ALL) + FOOTER,
}


def contents(file: Path) -> list[tuple[str, bytes, int]]:
    return [(one.topic, one.data, one.log_time_ns) for one in BagReader(file).messages()]


@pytest.mark.parametrize("name", UNUSUAL)
def test_it_is_read_and_called_sound(tmp_path: Path, name: str) -> None:
    file = tmp_path / "x.mcap"
    file.write_bytes(BEGIN + UNUSUAL[name])
    assert contents(file) == RIDE
    report = repair.repair(file)
    assert (report.rewritten, report.messages) == ([], len(RIDE))


@pytest.mark.parametrize("name", UNUSUAL)
def test_a_repair_of_one_that_is_cut_off_keeps_it(tmp_path: Path, name: str) -> None:
    file = tmp_path / "x.mcap"
    file.write_bytes((BEGIN + UNUSUAL[name])[: -len(FOOTER)])
    report = repair.repair(file)
    assert report.messages == len(RIDE)
    assert report.lost_messages == report.lost_chunks == report.lost_bytes == 0
    assert contents(file) == RIDE
    assert repair.repair(file).rewritten == []
    kept = record(0x20, b"future") if "later version" in name else b""
    assert kept in file.read_bytes()


def test_messages_of_a_topic_that_is_not_utf_8_are_kept(tmp_path: Path) -> None:
    file = tmp_path / "x.mcap"
    odd = channel(9, 1, b"/\xff") + said(9, FIRST, b"\0\1\0\0")
    file.write_bytes(BEGIN + chunk(ALL + odd))
    assert repair.repair(file).messages == len(RIDE) + 1
    assert BagReader(file).counts["/\\xff"] == 1
    assert repair.repair(file).rewritten == []


def test_a_message_whose_kind_is_wrong_is_no_record_of_a_later_version(tmp_path: Path) -> None:
    file = tmp_path / "x.mcap"
    broken = bytearray(MESSAGES[HALF])
    broken[0] ^= 0x10
    file.write_bytes(
        BEGIN + DEFINED + b"".join(MESSAGES[:HALF]) + broken + b"".join(MESSAGES[HALF + 1 :]) + END
    )
    report = repair.repair(file)
    assert report.messages == len(RIDE) - 1
    assert report.lost_bytes


@pytest.mark.parametrize("bit", [1, 3, 9, 33])
def test_a_wrong_head_outside_chunks_loses_one_message(tmp_path: Path, bit: int) -> None:
    broken = bytearray(MESSAGES[HALF + 3])
    broken[bit // 8] ^= 1 << bit % 8
    rest = [*MESSAGES[HALF : HALF + 3], bytes(broken), *MESSAGES[HALF + 4 :]]
    file = tmp_path / "x.mcap"
    inside = chunk(b"".join(MESSAGES[:HALF]))
    file.write_bytes(BEGIN + DEFINED + inside + b"".join(rest) + END)
    report = repair.repair(file)
    assert report.kept
    assert contents(file) == RIDE[: HALF + 3] + RIDE[HALF + 4 :]


def test_messages_in_a_broken_chunk_are_not_taken_for_others(tmp_path: Path) -> None:
    file = tmp_path / "x.mcap"
    first, second = bytearray(chunk(BODY)), chunk(BODY)
    first[60] ^= 1
    file.write_bytes(BEGIN + DEFINED + second + first + END)
    assert repair.repair(file).messages == len(RIDE)


@pytest.mark.parametrize("zeroed", [8, 512])
def test_a_file_whose_beginning_is_zeroed_is_found_by_its_index(
    tmp_path: Path, zeroed: int
) -> None:
    make_bag(tmp_path / "bag", 100, chunk_bytes=2048)
    file = tmp_path / "bag" / "bag_0.mcap"
    before = contents(file)
    file.write_bytes(bytes(zeroed) + file.read_bytes()[zeroed:])
    with pytest.raises(BagError, match=r"its first bytes are wrong.*--repair"):
        contents(file)
    report = repair.repair(tmp_path / "bag")
    assert report.kept
    after = contents(file)
    assert report.messages == len(after)
    assert after == before[len(before) - len(after) :]
    assert len(after) >= len(before) - (0 if zeroed == 8 else 20)


@pytest.mark.parametrize("act", [repair.repair, BagReader])
@pytest.mark.parametrize("one", [record(0x90, b""), said(1, FIRST)], ids=["private", "message"])
def test_a_chunk_of_too_many_records_ends_with_one_line(
    tmp_path: Path, one: bytes, act: Callable[[Path], object], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(walk, "MOST_RECORDS", 1000)
    plain = DEFINED + 1200 * one
    file = tmp_path / "x.mcap"
    file.write_bytes(BEGIN + chunk(plain, "zstd", zstandard.compress(plain)) + END)
    before = file.read_bytes()
    with pytest.raises(BagError, match="a chunk holds more than 1000 records"):
        act(file)
    assert file.read_bytes() == before
    monkeypatch.setattr(walk, "MOST_RECORDS", 1206)
    act(file)


APPENDED = {
    "bytes": b"garbage behind the magic",
    "zeros": bytes(5000),
    "a file": BEGIN + DEFINED + chunk(BODY) + END,
    "a file that is cut off": BEGIN + chunk(ALL),
    "a file whose end is damaged": BEGIN + chunk(ALL) + END[:-3],
}


@pytest.mark.parametrize("kind", APPENDED)
@pytest.mark.parametrize("summarised", [False, True])
def test_what_lies_behind_the_end_is_read_or_told(
    tmp_path: Path, kind: str, summarised: bool
) -> None:
    make_bag(tmp_path / "bag", 20)
    (made,) = (tmp_path / "bag").glob("*.mcap")
    whole = made.read_bytes() if summarised else BEGIN + chunk(ALL) + END
    file = tmp_path / "x.mcap"
    file.write_bytes(whole + APPENDED[kind])
    report = repair.repair(file)
    files = 2 if "file" in kind else 1
    found = [(one.topic, one.data, one.log_time_ns) for one in BagReader(file).messages()]
    assert found == RIDE * files
    assert [kept.read_bytes() for kept in report.kept] == [whole + APPENDED[kind]]
    assert report.lost_bytes >= (0 if files == 2 else len(APPENDED[kind]))


def test_what_lies_behind_a_packed_chunk_is_left_out(tmp_path: Path) -> None:
    file = tmp_path / "x.mcap"
    packed = lz4.frame.compress(ALL) + b"garbage"
    file.write_bytes(BEGIN + chunk(ALL, "lz4", packed) + END)
    assert len(list(BagReader(file).messages())) == len(RIDE)
