"""Repair of files that others wrote: what is not understood is kept as it was."""

from __future__ import annotations

import struct
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import pytest
import yaml
from foreign_bag import ForeignFile
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.writer import CompressionType, IndexType
from ride_bag import make_bag, ride

from bicycle_bag import container, repair
from bicycle_bag.errors import BagError
from bicycle_bag.reader import BagReader

PRIVATE = struct.pack("<BQ", 0x9A, 11) + b"ours, alone"
IMAGE = bytes(range(256)) * 40
Content = dict[str, Any]


def write(path: Path, **options: Any) -> Path:
    """Return a file with something of everything that the format knows."""
    with ForeignFile(path, profile="lab", library="another 1.0", **options) as file:
        writer = file.writer
        writer.add_attachment(7, 8, "map.png", "image/png", IMAGE)
        writer.add_metadata("run", {"driver": "Åse", "seed": "3"})
        file.ride_channels()
        kinds = {
            "/json": ("plot", b'{"type": "object"}', "jsonschema", "json"),
            "/proto": ("foxglove.Scene", b"\0\1\2\xff", "protobuf", "protobuf"),
            "/idl": ("a/msg/B", b"module a { };", "ros2idl", "cdr"),
            "/bare": ("", b"", "", "text"),
        }
        for topic, (type_name, definition, schema_encoding, encoding) in kinds.items():
            file.channel(topic, type_name, definition, schema_encoding, encoding, {"by": "us"})
        schema = writer.register_schema("other", "ros2msg", b"float64 x\n")
        twice = writer.register_channel("/json", "cdr", schema, {"second": "yes"})
        for number, (topic, data, now) in enumerate(ride(30)):
            writer.add_message(file.channels[topic], now, data, now - 5, number)
            for other in kinds:
                writer.add_message(
                    file.channels[other], now, b"%d" % number, now, 2**32 - 1 - number
                )
            writer.add_message(twice, now, b"\0\1\0\0", now, 5)
            if number % 20 == 10:
                writer.flush()  # type: ignore[no-untyped-call]
                writer._Writer__record_builder.write(PRIVATE)  # type: ignore[attr-defined]
                writer.add_metadata(f"note {number}", {"": ""})
        writer.add_attachment(0, 0, "", "", b"")
    return path


def content(path: Path) -> Content:
    """Return all of it, by the MCAP package: messages with their channel and its schema."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        header = reader.get_header()
        messages: list[tuple[Schema | None, Channel, Message]] = list(
            reader.iter_messages(log_time_order=False)
        )
        attachments: list[Attachment] = list(reader.iter_attachments())
        metadata: list[Metadata] = list(reader.iter_metadata())
        summary = reader.get_summary()
    assert summary is not None
    return {
        "header": header,
        "messages": messages,
        "attachments": attachments,
        "metadata": metadata,
        "channels": summary.channels,
        "schemas": summary.schemas,
        "private": path.read_bytes().count(PRIVATE),
    }


def cut_off(data: bytes) -> bytes:
    return data[:-20]


def in_the_summary(data: bytes) -> bytes:
    return data[:-60] + bytes([data[-60] ^ 1]) + data[-59:]


def in_an_index(data: bytes) -> bytes:
    at = data.index(PRIVATE) - 5
    return data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]


OPTIONS: dict[str, dict[str, Any]] = {
    "zstd": {"chunk_size": 2000},
    "lz4": {"chunk_size": 2000, "compression": CompressionType.LZ4},
    "uncompressed": {"chunk_size": 2000, "compression": CompressionType.NONE},
    "without checksums": {"chunk_size": 2000, "enable_crcs": False},
    "without chunks": {"use_chunking": False},
    "with a checksum of all": {"chunk_size": 2000, "enable_data_crcs": True},
}


def places_of(file: Path) -> list[tuple[int, int, int]]:
    """Return opcode, beginning and end of each record of a file outside its chunks."""
    with file.open("rb") as stream:
        stream.read(8)
        return [
            (one.opcode, at, at + container.HEAD.size + len(one.body))
            for at, one in container.records(stream, file.stat().st_size)
        ]


@pytest.mark.parametrize(
    ("damage", "name"),
    [
        (damage, name)
        for damage, name in product((cut_off, in_the_summary, in_an_index), OPTIONS)
        if (damage, name) != (in_an_index, "without chunks")  # where no index is
    ],
)
def test_a_repair_keeps_all_that_others_wrote(
    tmp_path: Path, name: str, damage: Callable[[bytes], bytes]
) -> None:
    file = write(tmp_path / "x.mcap", **OPTIONS[name])
    wanted = content(file)
    file.write_bytes(damage(file.read_bytes()))
    report = repair.repair(file)
    assert report.rewritten == [file] or (damage, name) == (in_the_summary, "without checksums")
    assert (report.lost_messages, report.lost_chunks, report.lost_bytes) == (0, 0, 0)
    assert report.messages == len(wanted["messages"])
    assert content(file) == wanted
    assert repair.repair(file).rewritten == []
    assert BagReader(file).message_count == report.messages


def test_a_lost_chunk_takes_nothing_else_with_it(tmp_path: Path) -> None:
    file = write(tmp_path / "x.mcap", chunk_size=2000)
    wanted = content(file)
    data = bytearray(file.read_bytes())
    with file.open("rb") as stream:
        stream.read(8)
        chunks = [
            offset for offset, one in container.records(stream, len(data)) if one.opcode == 6
        ]
    data[chunks[0] + 100] ^= 1
    file.write_bytes(data)
    report = repair.repair(file)
    found = content(file)
    lost = len(wanted["messages"]) - len(found["messages"])
    assert 0 < lost == report.lost_messages < 100
    assert found["messages"] == wanted["messages"][lost:]
    for part in ("header", "attachments", "metadata", "channels", "schemas", "private"):
        assert found[part] == wanted[part], part
    with file.open("rb") as stream:  # by a reader that knows no index: each topic is defined again
        in_order = NonSeekingReader(stream).iter_messages(log_time_order=False)
        assert [(one.topic, message) for _, one, message in in_order] == [
            (one.topic, message) for _, one, message in found["messages"]
        ]
    (kept,) = report.kept
    assert kept.read_bytes() == data


@pytest.mark.parametrize("finished", [True, False])
@pytest.mark.parametrize(
    ("compression", "hit"),
    [(CompressionType.NONE, -20), (CompressionType.NONE, 33), (CompressionType.ZSTD, 33)],
    ids=["a message", "the checksum", "the checksum, packed"],
)
def test_what_other_chunks_hold_outlives_the_only_one_that_defines_the_topics(
    tmp_path: Path, compression: CompressionType, hit: int, finished: bool
) -> None:
    """A chunk that is packed and damaged in its only block says nothing any more."""
    file, messages = tmp_path / "x.mcap", ride(600)
    bare: dict[str, Any] = {
        "repeat_channels": False,
        "repeat_schemas": False,
        "chunk_size": 60_000,
    }
    with ForeignFile(file, compression=compression, **bare) as result:
        result.ride_channels()
        for topic, data, now in messages:
            result.write(topic, data, now)
    damaged = bytearray(file.read_bytes())
    ends = [(at, end) for opcode, at, end in places_of(file) if opcode == 6]
    assert len(ends) > 3
    if not finished:
        del damaged[ends[-1][1] :]
    damaged[ends[0][hit < 0] + hit] ^= 4
    file.write_bytes(damaged)
    report = repair.repair(file)
    found = [(one.topic, one.data, one.log_time_ns) for one in BagReader(file).messages()]
    assert 0 < len(found) == report.adopted < len(messages)
    assert found == messages[-len(found) :]
    assert "only damaged parts of the file say topics and types of" in str(report)
    assert [kept.read_bytes() for kept in report.kept] == [bytes(damaged)]
    assert report.lost_chunks == 1
    if finished:
        assert report.lost_messages == len(messages) - len(found)


@pytest.mark.parametrize("kind", [2, 3, 4, 8, 11, 14])
@pytest.mark.parametrize("compression", list(CompressionType))
def test_a_damaged_summary_still_says_what_a_damaged_chunk_defined(
    tmp_path: Path, compression: CompressionType, kind: int
) -> None:
    """Two flips: one in the only chunk that defines the topics, one in the summary.

    A flip in the name of a topic, of which nothing else is left, changes that topic alone.
    """
    file, messages = tmp_path / "x.mcap", ride(100)
    with ForeignFile(file, compression=compression, chunk_size=3000) as result:
        result.ride_channels()
        for topic, data, now in messages:
            result.write(topic, data, now)
    damaged, places = bytearray(file.read_bytes()), places_of(file)
    chunk = next(at for opcode, at, _ in places if opcode == 6)
    data_end = next(at for opcode, at, _ in places if opcode == 15)
    hit = next(at for opcode, at, _ in places if opcode == kind and at > data_end)
    damaged[chunk + 60] ^= 4  # in its first definition
    damaged[hit + (26 if kind == 2 else 17)] ^= 1
    file.write_bytes(damaged)
    report = repair.repair(file)
    found = [(one.data, one.log_time_ns) for one in BagReader(file).messages()]
    kept = [(data, now) for _, data, now in messages]
    assert len(messages) * 0.8 < len(found) == report.adopted
    assert found == kept[-len(found) :]
    assert "only damaged parts of the file say topics and types of" in str(report)
    assert [one.read_bytes() for one in report.kept] == [bytes(damaged)]
    named = set(BagReader(file).topics) & {"/bicycle/state", "/bicycle/command"}
    assert len(named) == (1 if kind == 4 else 2)


def test_a_damaged_attachment_is_told_and_the_original_kept(tmp_path: Path) -> None:
    file = write(tmp_path / "x.mcap", chunk_size=2000)
    data = bytearray(file.read_bytes())
    data[data.index(IMAGE) + 300] ^= 1
    file.write_bytes(data)
    report = repair.repair(file)
    assert report.lost_bytes > len(IMAGE)
    assert f"lost: {report.lost_bytes} bytes" in str(report)
    assert [kept.read_bytes() for kept in report.kept] == [data]
    assert [one.name for one in content(file)["attachments"]] == [""]


def test_an_attachment_larger_than_a_record_may_be_is_no_damage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bicycle_bag.walk.MAX_RECORD_BYTES", len(IMAGE) - 1)
    file = write(tmp_path / "x.mcap", chunk_size=2000)
    wanted = content(file)
    assert BagReader(file).message_count == len(list(BagReader(file).messages()))
    assert repair.repair(file).rewritten == []
    file.write_bytes(file.read_bytes()[:-20])
    repair.repair(file)
    assert content(file) == wanted


def unusual() -> dict[str, dict[str, Any]]:
    """Options that leave out what a file need not have."""
    switches = ("repeat_channels", "repeat_schemas", "use_statistics", "use_summary_offsets")
    found: dict[str, dict[str, Any]] = {f"no {name}": {name: False} for name in switches}
    for index in (IndexType.NONE, IndexType.CHUNK, IndexType.MESSAGE, IndexType.METADATA):
        found[f"index {index.name}"] = {"index_types": index}
    bare = dict.fromkeys(switches, False) | {"index_types": IndexType.NONE, "enable_crcs": False}
    found["no summary"] = bare
    return {
        f"{name}, {packing}": {**options, **OPTIONS[packing]}
        for (name, options), packing in product(found.items(), OPTIONS)
    }


@pytest.mark.parametrize("name", unusual())
def test_what_is_only_unusual_is_not_called_damaged(tmp_path: Path, name: str) -> None:
    options = unusual()[name]
    file = write(tmp_path / "bag" / "x.mcap", **options)
    before = file.read_bytes()
    reader = BagReader(file.parent)
    found = [(m.topic, m.data) for m in reader.messages()]
    assert len(found) == reader.message_count == 6 * len(ride(30))
    assert reader.topics["/proto"].type == "foxglove.Scene"
    assert [one for one in found if one[0] in ("/bicycle/state", "/bicycle/command")] == [
        (topic, data) for topic, data, _ in ride(30) if topic != "/bicycle/episode"
    ]
    report = repair.repair(file.parent)
    assert (report.messages, report.rewritten, report.kept) == (len(found), [], [])
    assert file.read_bytes() == before


@pytest.mark.parametrize("what", ["packing", "size"])
def test_a_chunk_that_cannot_be_read_here_is_said_so_and_not_left_out(
    tmp_path: Path, what: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = write(tmp_path / "x.mcap", chunk_size=20_000, enable_crcs=False)
    if what == "packing":
        file.write_bytes(file.read_bytes().replace(b"\4\0\0\0zstd", b"\4\0\0\0xyz1"))
    else:
        for module in ("walk", "container"):
            monkeypatch.setattr(f"bicycle_bag.{module}.MAX_RECORD_BYTES", 9_000)
    before = file.read_bytes()
    for action in (lambda: list(BagReader(file).messages()), lambda: [repair.repair(file)]):
        with pytest.raises(BagError, match=r"x\.mcap cannot be read: .* be read here$"):
            action()
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [before]


@pytest.mark.parametrize("name", OPTIONS)
def test_a_file_without_a_message_is_whole(tmp_path: Path, name: str) -> None:
    file = tmp_path / "x.mcap"
    with ForeignFile(file, **OPTIONS[name]) as result:
        result.ride_channels()
    assert list(BagReader(file).messages()) == []
    assert repair.repair(file).rewritten == []


def test_a_repair_leaves_the_metadata_of_others_alone(tmp_path: Path) -> None:
    make_bag(tmp_path / "bag", 20)
    file = tmp_path / "bag" / "metadata.yaml"
    stored = yaml.safe_load(file.read_text())
    about = stored["rosbag2_bagfile_information"]
    about |= {"version": 8, "ros_distro": "iron", "custom_data": {"who": "they"}, "more": 1}
    file.write_text(yaml.safe_dump(stored))
    before = file.read_bytes()
    repair.repair(tmp_path / "bag")
    assert file.read_bytes() == before
    about["message_count"] += 1
    about["topics_with_message_count"][0]["message_count"] += 1
    file.write_text(yaml.safe_dump(stored))
    before = file.read_bytes()
    report = repair.repair(tmp_path / "bag")
    assert [kept.read_bytes() for kept in report.kept] == [before]
    found = BagReader(tmp_path / "bag").metadata
    assert found.custom_data == {"seed": "7", "who": "they"}
    assert found.ros_distro == "iron"
