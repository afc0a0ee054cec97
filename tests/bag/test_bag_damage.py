"""Broken, foreign and full: one clear line, and repair gets back what is whole."""

from __future__ import annotations

import random
import resource
import shutil
import struct
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest
import yaml
from mcap.opcode import Opcode
from ride_bag import COMMAND, STATE, Message, make_bag, ride
from rosbags.highlevel import AnyReader

from bicycle_bag import columns, container, repair
from bicycle_bag.errors import BagError
from bicycle_bag.metadata import Topic
from bicycle_bag.reader import BagReader
from bicycle_bag.writer import BagWriter

STEPS = 150


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Return a bag of several small chunks."""
    make_bag(tmp_path / "bag", STEPS, chunk_bytes=4096)
    return tmp_path / "bag"


def content(path: Path) -> list[Message]:
    return [(m.topic, m.data, m.log_time_ns) for m in BagReader(path).messages()]


def one_line(error: pytest.ExceptionInfo[BagError]) -> str:
    text = str(error.value)
    assert "\n" not in text
    return text


def error_of(action: Callable[[], object]) -> str:
    """Return the text of the BagError that an action ends in, or nothing."""
    try:
        action()
    except BagError as error:
        return str(error)
    return ""


def record_ends(file: Path) -> list[tuple[int, int]]:
    """Return (opcode, end offset) of each top-level record."""
    with file.open("rb") as stream:
        stream.read(len(container.MAGIC))
        return [
            (record.opcode, offset + 9 + len(record.body))
            for offset, record in container.records(stream, file.stat().st_size)
        ]


def messages_before(file: Path, cut: int) -> int:
    """Return the number of messages in whole chunks before byte `cut`."""
    whole = sum(1 for code, end in record_ends(file) if code == Opcode.CHUNK and end <= cut)
    counted = 0
    with file.open("rb") as stream:
        stream.read(len(container.MAGIC))
        for _, record in container.records(stream, file.stat().st_size):
            if record.opcode == Opcode.CHUNK and whole:
                whole -= 1
                inner = container.chunk_records(record.body)
                counted += sum(1 for item in inner if item.opcode == Opcode.MESSAGE)
    return counted


def test_truncation_anywhere_is_told_and_repaired(bag: Path, tmp_path: Path) -> None:
    whole = bag / "bag_0.mcap"
    size = whole.stat().st_size
    ends = [end for _, end in record_ends(whole)]
    rng = random.Random(1)
    cuts = {0, 3, 8, 9, size - 1, size - 8, size - 9, *rng.sample(range(size), 20)}
    cuts |= {end + shift for end in rng.sample(ends, 10) for shift in (-1, 0, 5)}
    for cut in sorted(cut for cut in cuts if cut < size):
        broken = tmp_path / f"cut_{cut}"
        broken.mkdir()
        (broken / "bag_0.mcap").write_bytes(whole.read_bytes()[:cut])
        with pytest.raises(BagError) as error:
            BagReader(broken)
        assert "record.sh --repair" in one_line(error)
        report = repair.repair(broken)
        expected = ride(STEPS)[: messages_before(whole, cut)]
        assert content(broken) == expected
        assert report.messages == len(expected)
        if expected:
            with AnyReader([broken]) as reader:
                assert reader.message_count == len(expected)


def test_repair_leaves_a_whole_bag_alone(bag: Path) -> None:
    before = {path.name: path.read_bytes() for path in bag.iterdir()}
    report = repair.repair(bag)
    assert (report.messages, report.rewritten, report.kept) == (2 * STEPS + 1, [], [])
    assert {path.name: path.read_bytes() for path in bag.iterdir()} == before


def test_repair_restores_lost_metadata(bag: Path) -> None:
    before = (bag / "metadata.yaml").read_bytes()
    (bag / "metadata.yaml").unlink()
    assert BagReader(bag).message_count == 2 * STEPS + 1
    repair.repair(bag)
    assert (bag / "metadata.yaml").read_bytes() == before


def test_repair_of_a_split_bag_rewrites_only_the_last_file(tmp_path: Path) -> None:
    make_bag(tmp_path / "bag", 100, split_seconds=1.0, chunk_bytes=1024)
    bag = tmp_path / "bag"
    (bag / "metadata.yaml").unlink()
    last = bag / "bag_2.mcap"
    last.write_bytes(last.read_bytes()[:-40])
    report = repair.repair(bag)
    assert report.rewritten == [last]
    assert content(bag) == ride(100)


def test_a_corrupt_chunk_costs_that_chunk_alone(bag: Path) -> None:
    file = bag / "bag_0.mcap"
    data = bytearray(file.read_bytes())
    chunk_ends = [end for code, end in record_ends(file) if code == Opcode.CHUNK]
    assert len(chunk_ends) > 4
    data[chunk_ends[0] - 20] ^= 0xFF  # the first holds schemas and channels besides
    file.write_bytes(data)
    reader = BagReader(bag)
    with pytest.raises(BagError) as error:
        list(reader.messages())
    assert "damaged" in one_line(error)
    report = repair.repair(bag)
    assert report.lost_chunks == 1
    assert file.with_name("bag_0.mcap.damaged").read_bytes() == bytes(data)
    assert 0 < len(content(bag)) == report.messages < 2 * STEPS + 1
    assert BagReader(bag).metadata.custom_data == {"seed": "7"}


def test_flipped_bits_never_hang_nor_traceback(bag: Path, tmp_path: Path) -> None:
    file = bag / "bag_0.mcap"
    original = file.read_bytes()
    rng = random.Random(2)
    for trial in range(60):
        data = bytearray(original)
        for _ in range(rng.choice([1, 1, 3, 50])):
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        target = tmp_path / f"flip_{trial}.mcap"
        target.write_bytes(data)
        assert "\n" not in error_of(partial(columns.load_topics, target, [STATE, COMMAND]))
        trouble = error_of(partial(repair.repair, target))
        assert trouble == "" or "not an MCAP file" in trouble
        if not trouble:
            list(BagReader(target).messages())


def test_announced_sizes_are_not_trusted(tmp_path: Path) -> None:
    start = container.MAGIC + struct.pack("<BQ", 1, 8) + bytes(8)
    huge_record = start + struct.pack("<BQ", 5, 2**62) + bytes(100)
    body = struct.pack("<QQQI", 0, 0, 2**50, 0) + struct.pack("<I", 0) + struct.pack("<Q", 0)
    huge_chunk = start + struct.pack("<BQ", 6, len(body)) + body
    end = struct.pack("<BQI", 15, 4, 0) + struct.pack("<BQQQI", 2, 20, 0, 0, 0) + container.MAGIC
    for name, data in (("record", huge_record), ("chunk", huge_chunk)):
        path = tmp_path / f"{name}.mcap"
        path.write_bytes(data + end)
        with pytest.raises(BagError, match=r"record\.sh --repair"):
            list(BagReader(path).messages())
        assert repair.repair(path).messages == 0
        assert list(BagReader(path).messages()) == []


@pytest.mark.parametrize("what", ["missing", "empty directory", "text", "foreign metadata"])
def test_what_is_no_bag_is_said_in_one_line(tmp_path: Path, what: str, bag: Path) -> None:
    path = tmp_path / "thing"
    if what == "empty directory":
        path.mkdir()
    elif what == "text":
        path.write_text("no bag at all")
    elif what == "foreign metadata":
        shutil.copytree(bag, path)
        (path / "metadata.yaml").write_text("- 1\n")
    with pytest.raises(BagError) as error:
        BagReader(path)
    assert str(path) in one_line(error)
    if what != "foreign metadata":
        with pytest.raises(BagError):
            repair.repair(path)


def test_other_storages_and_missing_files_are_named(bag: Path) -> None:
    path = bag / "metadata.yaml"
    stored = yaml.safe_load(path.read_text())
    (bag / "bag_0.mcap").rename(bag / "other.mcap")
    with pytest.raises(BagError, match=r"lacks its file 'bag_0\.mcap"):
        BagReader(bag)
    repair.repair(bag)
    assert BagReader(bag).message_count == 2 * STEPS + 1
    stored["rosbag2_bagfile_information"]["storage_identifier"] = "sqlite3"
    path.write_text(yaml.safe_dump(stored))
    with pytest.raises(BagError, match="ros2 bag convert"):
        BagReader(bag)


def test_an_existing_directory_is_refused(bag: Path) -> None:
    with pytest.raises(BagError, match="exists: choose another name"):
        BagWriter(bag)
    assert BagReader(bag).message_count == 2 * STEPS + 1


def test_options_out_of_range_are_refused(tmp_path: Path) -> None:
    for options in ({"compression": "gzip"}, {"split_bytes": 10}, {"split_seconds": -1.0}):
        with pytest.raises(BagError, match="choose"):
            BagWriter(tmp_path / "bag", **options)
    assert not (tmp_path / "bag").exists()


@pytest.fixture
def small_disk() -> Iterator[None]:
    """Files of this process cannot grow beyond 20 kB, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_full_disk_keeps_what_was_written(tmp_path: Path, small_disk: None) -> None:
    writer = BagWriter(tmp_path / "bag", compression="none", chunk_bytes=1000)
    writer.add_topic(Topic("/numbers", "x/msg/Numbers"), "float64[64] values\n")
    trouble, written = "", -1
    while not trouble and written < 1000:
        written += 1
        data = b"\0\1\0\0" + bytes(512)
        trouble = error_of(partial(writer.write, "/numbers", data, written, written))
    assert "free some space" in trouble
    report = repair.repair(tmp_path / "bag")
    assert written - 5 <= report.messages <= written + 1


def test_repair_command(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (bag / "metadata.yaml").unlink()
    file = bag / "bag_0.mcap"
    file.write_bytes(file.read_bytes()[:-10])
    assert repair.main([str(bag)]) == 0
    assert f"{2 * STEPS + 1} messages are whole, 1 file" in capsys.readouterr().out
    assert repair.main([str(bag / "nothing")]) == 1
    assert capsys.readouterr().err.count("\n") == 1
