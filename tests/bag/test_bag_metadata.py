"""A bag's metadata.yaml of foreign origin: what it may name, and what it may cost."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
import yaml
from ride_bag import make_bag, ride

from bicycle_bag import repair
from bicycle_bag.errors import BagError
from bicycle_bag.reader import BagReader

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
    """The one line in which the bag is refused."""
    with pytest.raises(BagError) as told:
        BagReader(bag)
    text = str(told.value)
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


def test_a_pipe_in_place_of_a_file_is_not_waited_for(bag: Path) -> None:
    (bag / "bag_0.mcap").unlink()
    os.mkfifo(bag / "bag_0.mcap")
    assert "lacks its file" in refusal(bag)
    (bag / "metadata.yaml").unlink()
    os.mkfifo(bag / "metadata.yaml")
    assert "holds no .mcap file" in refusal(bag)
