"""Counts and times that a file's statistics have wrong are not passed on."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from foreign_bag import UNCHUNKED, ForeignFile
from mcap.opcode import Opcode
from ride_bag import TYPES, ride

from bicycle_bag import container, repair
from bicycle_bag.container import HEAD, MAGIC
from bicycle_bag.reader import BagReader

FOOTER = HEAD.size + 20 + len(MAGIC)
FORMS: dict[str, dict[str, Any]] = {
    "without chunks": UNCHUNKED | {"enable_crcs": False},
    "without checksums": {"enable_crcs": False, "chunk_size": 1500},
    "with checksums": {"chunk_size": 1500},
}
# Offsets in a statistics record: messages of all, first time, last time, the first channel's.
TOTAL, FIRST, LAST, CHANNEL = 0, 26, 34, 48


def written(path: Path, **options: Any) -> Path:
    with ForeignFile(path, library="rosbag2", **options) as file:
        file.ride_channels()
        for topic, data, now in ride(14):
            file.write(topic, data, now)
    return path


def with_other_statistics(file: Path, change: Callable[[bytearray], None]) -> None:
    """Change the statistics as another writer would, with its checksum."""
    data = bytearray(file.read_bytes())
    with file.open("rb") as stream:
        stream.seek(len(MAGIC))
        found = [(at, one) for at, one in container.records(stream, len(data))]
    ((at, record),) = [(at, one) for at, one in found if one.opcode == Opcode.STATISTICS]
    body = bytearray(record.body)
    change(body)
    data[at + HEAD.size : at + HEAD.size + len(body)] = body
    start, _, checksum = struct.unpack_from("<QQI", data, len(data) - FOOTER + HEAD.size)
    if checksum:
        new = zlib.crc32(data[start : -len(MAGIC) - 4])
        struct.pack_into("<I", data, len(data) - len(MAGIC) - 4, new)
    file.write_bytes(data)


def swapped(body: bytearray) -> None:
    """Count one message of the first channel for the second."""
    for at, step in ((CHANNEL, 1), (CHANNEL + 10, -1)):
        (count,) = struct.unpack_from("<Q", body, at)
        struct.pack_into("<Q", body, at, count + step)


CHANGES: dict[str, Callable[[bytearray], None]] = {
    "a channel": lambda body: struct.pack_into("<Q", body, CHANNEL, 9999),
    "a bit of a channel": lambda body: body.__setitem__(CHANNEL + 3, 4),
    "two channels": swapped,
    "the first time": lambda body: struct.pack_into("<Q", body, FIRST, 5),
    "the last time": lambda body: body.__setitem__(LAST + 7, 0),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("change", CHANGES)
def test_a_repair_corrects_them(tmp_path: Path, form: str, change: str) -> None:
    file = written(tmp_path / "x.mcap", **FORMS[form])
    right = BagReader(file)
    with_other_statistics(file, CHANGES[change])
    report = repair.repair(file)
    assert report.rewritten == [file]
    assert report.messages == len(ride(14))
    assert report.lost_messages == report.lost_chunks == report.lost_bytes == 0
    after = BagReader(file)
    assert after.counts == right.counts
    assert after.starting_time_ns == right.starting_time_ns
    assert after.duration_ns == right.duration_ns
    assert repair.repair(file).rewritten == []


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("change", sorted([name for name in CHANGES if name != "two channels"]))
def test_a_reader_counts_for_itself(tmp_path: Path, form: str, change: str) -> None:
    file = written(tmp_path / "x.mcap", **FORMS[form])
    right = BagReader(file)
    with_other_statistics(file, CHANGES[change])
    after = BagReader(file)
    assert after.counts == right.counts
    assert set(after.counts) == set(TYPES)
    assert after.duration_ns == right.duration_ns
