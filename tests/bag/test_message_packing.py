"""MCAP files whose messages rosbag2 compressed one by one."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
import yaml
import zstandard
from foreign_bag import UNCHUNKED, ForeignFile
from ride_bag import make_bag, ride

from bicycle_bag import metadata, repair
from bicycle_bag.errors import BagError
from bicycle_bag.reader import BagReader
from bicycle_cockpit import shelf

STEPS = 30
WANTED = [(topic, data) for topic, data, _ in ride(STEPS)]
REMEDY = "compressed one by one: record.sh --repair unpacks them"


def packed_file(path: Path, **options: Any) -> Path:
    """Return a file as `ros2 bag record --compression-mode message` leaves it."""
    with ForeignFile(path, library="rosbag2", **options) as file:
        file.ride_channels()
        bare = file.channel("/bare", encoding="text")
        for topic, data, now in ride(STEPS):
            file.write(topic, zstandard.compress(data), now)
        file.writer.add_message(bare, now, zstandard.compress(b"as it was"), now)
        about = {"compression_mode": "MESSAGE", "compression_format": "zstd"}
        content = metadata.BagMetadata(custom_data={"seed": "7"}).to_yaml_map() | about
        file.writer.add_metadata("rosbag2", {"serialized_metadata": yaml.safe_dump(content)})
    return path


@pytest.fixture(params=[{}, UNCHUNKED, {"chunk_size": 1500}], ids=["one", "none", "several"])
def bag(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    make_bag(tmp_path / "bag", STEPS)
    packed_file(tmp_path / "bag" / "bag_0.mcap", **request.param)
    path = tmp_path / "bag" / metadata.FILE_NAME
    content = yaml.safe_load(path.read_text())
    content[metadata.ROOT].update(compression_mode="MESSAGE", compression_format="zstd")
    path.write_text(yaml.safe_dump(content))
    return tmp_path / "bag"


def messages(path: Path) -> list[tuple[str, bytes]]:
    return [(one.topic, one.data) for one in BagReader(path).messages() if one.topic != "/bare"]


@pytest.mark.parametrize("what", ["folder", "folder without metadata", "file"])
def test_they_are_named_with_the_remedy_and_unpacked_by_a_repair(bag: Path, what: str) -> None:
    file = bag / "bag_0.mcap"
    path = file if what == "file" else bag
    before = file.read_bytes()
    if what == "folder without metadata":
        (bag / metadata.FILE_NAME).unlink()
    with pytest.raises(BagError, match=REMEDY):
        messages(path)
    report = repair.repair(path)
    assert report.unpacked == [bag / "bag_0.mcap.packed"]
    assert report.unpacked[0].read_bytes() == before
    assert "compressed one by one were unpacked, originals kept as" in str(report)
    assert report.messages == len(WANTED) + 1
    assert messages(path) == WANTED
    bare = [one.data for one in BagReader(path).messages(["/bare"])]
    assert bare == [zstandard.compress(b"as it was")]
    assert repair.repair(path).rewritten == []
    if what != "file":
        stored = yaml.safe_load((bag / metadata.FILE_NAME).read_text())[metadata.ROOT]
        assert stored["compression_mode"] == ""
        assert BagReader(bag).metadata.custom_data["seed"] == "7"


def test_the_cockpit_names_the_remedy(bag: Path) -> None:
    for file in bag.iterdir():  # one that is younger may still be written
        os.utime(file, (0, 0))
    assert REMEDY in shelf.entry("bag", bag)["problem"]


def test_one_that_is_corrupt_is_counted_as_lost(tmp_path: Path) -> None:
    file = tmp_path / "x.mcap"
    with ForeignFile(file, library="rosbag2") as out:
        out.ride_channels()
        for number, (topic, data, now) in enumerate(ride(STEPS)):
            packed = zstandard.compress(data)
            out.write(topic, packed[:-5] if number == 7 else packed, now)
    report = repair.repair(file)
    assert (report.messages, report.lost_messages) == (len(WANTED) - 1, 1)
    assert messages(file) == WANTED[:7] + WANTED[8:]


def test_a_bag_that_an_earlier_repair_called_whole_is_unpacked(bag: Path) -> None:
    """The metadata no longer name the compression."""
    path = bag / metadata.FILE_NAME
    path.write_text(path.read_text().replace("MESSAGE", "''"))
    with pytest.raises(BagError, match=REMEDY):
        messages(bag)
    repair.repair(bag)
    assert messages(bag) == WANTED
