"""A bag's metadata.yaml of foreign origin: what it may name, and what it may cost."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
import zstandard
from foreign_bag import ForeignFile
from ride_bag import make_bag, ride

from bicycle_bag import repair, unpacking
from bicycle_bag.errors import BagError
from bicycle_bag.metadata import Topic
from bicycle_bag.reader import BagReader
from bicycle_bag.writer import BagWriter

STEPS = 20
ROOT = "rosbag2_bagfile_information"


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    make_bag(tmp_path / "bag", STEPS)
    return tmp_path / "bag"


def stored(bag: Path) -> dict[str, Any]:
    content: dict[str, Any] = yaml.safe_load((bag / "metadata.yaml").read_text())[ROOT]
    return content


def store(bag: Path, content: dict[str, Any]) -> None:
    (bag / "metadata.yaml").write_text(yaml.safe_dump({ROOT: content}))


def name_files(bag: Path, *names: str) -> None:
    """Have metadata.yaml say that the bag is made of these files."""
    content = stored(bag)
    entry = content["files"][0]
    content["files"] = [{**entry, "path": name} for name in names]
    content["relative_file_paths"] = list(names)
    store(bag, content)


def refusal(bag: Path) -> str:
    """Return the one line in which the bag is refused."""
    with pytest.raises(BagError) as raised:
        BagReader(bag)
    text = str(raised.value)
    assert "\n" not in text
    assert len(text) < 600
    return text


def bombs() -> dict[str, str]:
    lines = ["a0: &a0 [x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 30)]
    aliases = "\n".join(lines)
    return {
        "aliases": f"{aliases}\n{ROOT}: {{version: 9, custom_data: {{a: *a29}}}}",
        "nesting": f"{ROOT}: " + "[" * 10**6,
        "a huge number": f"{ROOT}: {{version: {'9' * 10**6}}}",
        "a huge text": f"{ROOT}: {'x' * 10**7}",
    }


@pytest.mark.parametrize("kind", ["aliases", "nesting", "a huge number", "a huge text"])
def test_a_yaml_bomb_in_metadata_yaml_is_refused_and_repaired(bag: Path, kind: str) -> None:
    (bag / "metadata.yaml").write_text(bombs()[kind])
    assert "record.sh --repair" in refusal(bag)
    repair.repair(bag)
    assert [(m.topic, m.data, m.log_time_ns) for m in BagReader(bag).messages()] == ride(STEPS)


@pytest.mark.parametrize("kind", ["aliases", "nesting", "a huge number"])
def test_a_yaml_bomb_in_a_channels_qos_is_left_out(bag: Path, kind: str) -> None:
    content = stored(bag)
    content["topics_with_message_count"][0]["topic_metadata"]["offered_qos_profiles"] = bombs()[
        kind
    ]
    store(bag, content)
    assert BagReader(bag).message_count == 2 * STEPS + 1


@pytest.mark.parametrize("name", ["../../x.mcap", "../x.mcap", "bag/../../x.mcap", "..", ""])
def test_a_metadata_path_out_of_the_bags_folder_is_refused(bag: Path, name: str) -> None:
    outside = bag.parent / "x.mcap"
    outside.write_bytes((bag / "bag_0.mcap").read_bytes())
    (bag.parent.parent / "x.mcap").write_bytes(outside.read_bytes())
    name_files(bag, name)
    assert f"lacks its file {name!r}" in refusal(bag)


def test_an_absolute_metadata_path_is_refused(bag: Path) -> None:
    outside = bag.parent / "x.mcap"
    outside.write_bytes((bag / "bag_0.mcap").read_bytes())
    name_files(bag, str(outside))
    assert "lacks its file" in refusal(bag)
    name_files(bag, str(bag / "bag_0.mcap"))
    assert "lacks its file" in refusal(bag), "also one that leads back"


def test_a_link_out_of_the_bags_folder_is_refused(bag: Path) -> None:
    outside = bag.parent / "x.mcap"
    (bag / "bag_0.mcap").rename(outside)
    (bag / "bag_0.mcap").symlink_to(outside)
    assert "lacks its file 'bag_0.mcap'" in refusal(bag)
    (bag / "metadata.yaml").unlink()
    assert "holds no .mcap file" in refusal(bag)
    (bag / "bag_0.mcap").unlink()
    (bag / "folder").symlink_to(bag.parent)
    make_bag(bag.parent / "other", STEPS)
    (bag / "metadata.yaml").write_bytes((bag.parent / "other" / "metadata.yaml").read_bytes())
    name_files(bag, "folder/x.mcap")
    assert "lacks its file" in refusal(bag)


def test_a_bag_may_be_reached_by_a_link_and_hold_links_within(bag: Path) -> None:
    (bag / "files").mkdir()
    (bag / "bag_0.mcap").rename(bag / "files" / "a.mcap")
    (bag / "bag_0.mcap").symlink_to("files/a.mcap")
    link = bag.parent / "link"
    link.symlink_to(bag)
    assert BagReader(link).message_count == 2 * STEPS + 1


@pytest.mark.parametrize("name", ["bag/bag_0.mcap", "./bag_0.mcap"])
def test_old_ways_to_name_a_file_are_understood(bag: Path, name: str) -> None:
    name_files(bag, name)
    assert BagReader(bag).message_count == 2 * STEPS + 1


@pytest.mark.parametrize("name", ["x" * 5000, "a\0b", "a\nb.mcap", "circle"])
def test_a_name_that_no_file_can_have_is_one_line(bag: Path, name: str) -> None:
    (bag / "circle").symlink_to("circle")
    name_files(bag, name)
    assert "lacks its file" in refusal(bag)


@pytest.mark.parametrize("storage", ["", None, "missing"])
def test_a_storage_that_is_not_named_is_mcap(bag: Path, storage: str | None) -> None:
    content = stored(bag)
    content["storage_identifier"] = storage
    if storage == "missing":
        del content["storage_identifier"]
    store(bag, content)
    assert BagReader(bag).message_count == 2 * STEPS + 1


@pytest.mark.parametrize("storage", ["sqlite3", "x" * 5000, 7])
def test_another_storage_is_named_with_a_remedy(bag: Path, storage: object) -> None:
    store(bag, {**stored(bag), "storage_identifier": storage})
    assert "only mcap can be read here: " in refusal(bag)
    assert ("record.sh --repair makes one of it" in refusal(bag)) == (storage == "sqlite3")
    assert "ros2 bag convert" in refusal(bag)
    assert "on a machine that has ROS 2" in refusal(bag)


@pytest.mark.parametrize("mode", ["FILE", "file", "MESSAGE"])
def test_a_bag_that_was_compressed_as_a_whole_is_unpacked_by_a_repair(
    bag: Path, mode: str
) -> None:
    file, packed = bag / "bag_0.mcap", bag / "bag_0.mcap.zstd"
    before = file.read_bytes()
    packed.write_bytes(zstandard.compress(before))
    file.unlink()
    content = stored(bag)
    (entry,) = content["files"]
    named = {"files": [{**entry, "path": packed.name}], "relative_file_paths": [packed.name]}
    store(bag, {**content, **named, "compression_mode": mode, "compression_format": "zstd"})
    assert "compressed as a whole: record.sh --repair unpacks them" in refusal(bag)
    (bag / "metadata.yaml").rename(bag / "gone")
    assert "compressed as a whole: record.sh --repair unpacks it" in refusal(bag)
    (bag / "gone").rename(bag / "metadata.yaml")
    assert repair.repair(bag).messages == 2 * STEPS + 1
    assert [(m.topic, m.data, m.log_time_ns) for m in BagReader(bag).messages()] == ride(STEPS)
    assert file.read_bytes() == before
    assert packed.is_file()


def test_a_corrupt_compressed_file_is_one_line(bag: Path) -> None:
    packed = bag / "bag_0.mcap.zstd"
    packed.write_bytes(zstandard.compress((bag / "bag_0.mcap").read_bytes())[:-50] + b"x" * 50)
    (bag / "bag_0.mcap").unlink()
    with pytest.raises(BagError, match="cannot unpack") as raised:
        repair.repair(bag)
    assert "\n" not in str(raised.value)
    assert sorted(path.name for path in bag.iterdir()) == ["bag_0.mcap.zstd", "metadata.yaml"]


@pytest.mark.parametrize("start", [2**63 - 10**9, 2**63 - 1, 2**63 + 10**18, 2**64 - 10**10])
def test_times_of_2262_and_beyond_are_read_and_written(tmp_path: Path, start: int) -> None:
    bag = tmp_path / "bag"
    with BagWriter(bag, split_seconds=0.3) as writer:
        writer.add_topic(Topic("/numbers", "x/msg/Numbers"), "float64 x\n")
        for number in range(STEPS):
            now = start + number * 10**8
            writer.write("/numbers", b"\0\1\0\0" + bytes(8), now, now)
    written = (bag / "metadata.yaml").read_bytes()
    for _ in ("as written", "as repaired"):
        reader = BagReader(bag)
        assert (reader.starting_time_ns, reader.duration_ns) == (start, (STEPS - 1) * 10**8)
        assert [m.log_time_ns - start for m in reader.messages()] == [
            number * 10**8 for number in range(STEPS)
        ]
        content = stored(bag)
        assert content["starting_time"]["nanoseconds_since_epoch"] == min(start, 2**63 - 1)
        assert content["duration"]["nanoseconds"] == (STEPS - 1) * 10**8
        (bag / "metadata.yaml").unlink()
        assert repair.repair(bag).rewritten == []
        assert (bag / "metadata.yaml").read_bytes() == written


def test_a_pipe_in_place_of_a_file_is_not_waited_for(bag: Path) -> None:
    (bag / "bag_0.mcap").unlink()
    os.mkfifo(bag / "bag_0.mcap")
    assert "lacks its file" in refusal(bag)
    (bag / "metadata.yaml").unlink()
    os.mkfifo(bag / "metadata.yaml")
    assert "holds no .mcap file" in refusal(bag)


def packed_bag(tmp_path: Path) -> tuple[Path, bytes]:
    """Return the packed file of a bag that rosbag2 compressed as a whole, and its bytes."""
    made = tmp_path / "packed"
    make_bag(made, 500, compression="none")
    plain = made / "packed_0.mcap"
    packed = made / "packed_0.mcap.zstd"
    packed.write_bytes(zstandard.compress(plain.read_bytes()))
    plain.unlink()
    content = stored(made)
    content["files"][0]["path"] = content["relative_file_paths"][0] = packed.name
    content.update(compression_format="zstd", compression_mode="FILE")
    store(made, content)
    return packed, packed.read_bytes()


def test_a_packed_file_that_is_cut_off_is_told_and_not_taken_for_the_bag(tmp_path: Path) -> None:
    packed, whole = packed_bag(tmp_path)
    packed.write_bytes(whole[:-200])
    for _ in range(2):
        with pytest.raises(BagError, match=r"cut off.* all later ones are lost") as raised:
            repair.repair(packed.parent)
        assert list(packed.parent.glob("*.mcap")) == []
    said = re.search(r"first (\d+) messages .* --repair (\S+) makes", str(raised.value))
    assert said is not None
    assert 0 < int(said[1]) < 1001
    report = repair.repair(Path(said[2]))
    assert report.messages == int(said[1])
    packed.write_bytes(whole)
    assert repair.repair(packed.parent).messages == 1001
    assert BagReader(packed.parent).message_count == 1001


def test_a_whole_packed_file_replaces_what_a_cut_one_left(tmp_path: Path) -> None:
    packed, whole = packed_bag(tmp_path)
    left = packed.with_suffix("")
    left.write_bytes(zstandard.decompress(whole)[:9000])
    assert repair.repair(packed.parent).messages == 1001
    assert left.with_name(f"{left.name}.damaged").stat().st_size == 9000


def test_a_packed_file_of_several_frames_is_whole(tmp_path: Path) -> None:
    packed, whole = packed_bag(tmp_path)
    plain = zstandard.decompress(whole)
    packed.write_bytes(zstandard.compress(plain[:5000]) + zstandard.compress(plain[5000:]))
    assert repair.repair(packed.parent).messages == 1001


@pytest.mark.parametrize("limit", ["size", "disk"])
def test_a_packed_bomb_ends_with_one_line(
    tmp_path: Path, limit: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    packed, _ = packed_bag(tmp_path)
    packed.write_bytes(zstandard.compress(bytes(20 * 2**20)))
    if limit == "size":
        monkeypatch.setattr(unpacking, "LEAST_LIMIT", 2**20)
    else:
        usage = shutil.disk_usage(tmp_path)._replace(free=17 * 2**20)
        monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    said = "more than 2000 times its size" if limit == "size" else "more than the 1 MiB"
    with pytest.raises(BagError, match=said):
        repair.repair(packed.parent)
    assert {file.name for file in packed.parent.iterdir()} == {packed.name, "metadata.yaml"}


@pytest.mark.parametrize("number", [float("inf"), float("-inf"), float("nan")])
@pytest.mark.parametrize("where", ["topic", "file", "start", "duration"])
def test_a_number_that_is_none_is_one_line_and_repaired(
    bag: Path, number: float, where: str
) -> None:
    content = stored(bag)
    (file,) = content["files"]
    if where == "topic":
        content["topics_with_message_count"][0]["message_count"] = number
    elif where == "file":
        file["message_count"] = number
    elif where == "start":
        file["starting_time"]["nanoseconds_since_epoch"] = number
    else:
        file["duration"]["nanoseconds"] = number
    store(bag, content)
    assert "is not rosbag2 metadata" in refusal(bag)
    assert repair.repair(bag).messages == 2 * STEPS + 1
    assert BagReader(bag).odd == ""


def test_a_number_that_is_none_in_the_metadata_of_a_file_is_left_out(tmp_path: Path) -> None:
    text = (
        "topics_with_message_count: []\nrelative_file_paths: []\nfiles: [{path: a, starting_time: "
        "{nanoseconds_since_epoch: .inf}, duration: {nanoseconds: 0}, message_count: 1}]\n"
    )
    with ForeignFile(tmp_path / "x.mcap", library="rosbag2") as file:
        file.ride_channels()
        for topic, data, now in ride(STEPS):
            file.write(topic, data, now)
        file.writer.add_metadata("rosbag2", {"serialized_metadata": text})
    assert repair.repair(tmp_path / "x.mcap").messages == 2 * STEPS + 1


ODD: dict[str, Callable[[dict[str, Any]], object]] = {
    "it names a file twice": lambda content: content.update(
        files=2 * content["files"], relative_file_paths=2 * content["relative_file_paths"]
    ),
    "it names no file": lambda content: content.update(files=[], relative_file_paths=[]),
    "it counts 0 messages where there are 41": lambda content: content.update(
        topics_with_message_count=None
    ),
    "it counts 1e+24 messages where there are 41": lambda content: content[
        "topics_with_message_count"
    ][0].update(message_count=10**24),
    "it counts the messages of its topics wrong": lambda content: [
        one.update(message_count=number)
        for one, number in zip(content["topics_with_message_count"], (40, 1, 0), strict=True)
    ],
    "its times are wrong: the start": lambda content: content["files"][0].update(
        starting_time={"nanoseconds_since_epoch": 10**40}
    ),
    "its times are wrong": lambda content: content["files"][0].update(
        duration={"nanoseconds": 10**30}
    ),
}


@pytest.mark.parametrize("odd", ODD)
def test_what_the_metadata_have_wrong_is_told_and_taken_from_the_files(
    bag: Path, odd: str
) -> None:
    right = BagReader(bag)
    content = stored(bag)
    ODD[odd](content)
    store(bag, content)
    reader = BagReader(bag)
    assert odd.startswith(reader.odd)
    assert reader.odd
    assert [(m.topic, m.data, m.log_time_ns) for m in reader.messages()] == ride(STEPS)
    assert reader.counts == right.counts
    assert reader.duration_ns == right.duration_ns
    assert f"written anew, as {reader.odd}" in str(repair.repair(bag))
    assert BagReader(bag).odd == ""
    assert repair.repair(bag).odd == ""


def test_files_that_macos_leaves_are_no_part_of_the_bag(bag: Path) -> None:
    for ending in ("mcap", "db3", "mcap.zstd"):
        (bag / f"._bag_0.{ending}").write_bytes(b"\0\5\x16\7" + bytes(100))
    (bag / "metadata.yaml").unlink()
    assert BagReader(bag).message_count == 2 * STEPS + 1
    assert repair.repair(bag).rewritten == []
    assert BagReader(bag).odd == ""


@pytest.mark.parametrize("has_metadata", [True, False])
def test_a_bag_that_is_only_a_link_names_the_link(bag: Path, has_metadata: bool) -> None:
    file = bag / "bag_0.mcap"
    file.rename(bag.parent / "elsewhere.mcap")
    file.symlink_to(bag.parent / "elsewhere.mcap")
    if not has_metadata:
        (bag / "metadata.yaml").unlink()
    assert f"{file.name} is a link to {bag.parent / 'elsewhere.mcap'}, out of the bag" in refusal(
        bag
    )
