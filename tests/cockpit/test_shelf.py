"""The shelf of bags: what it lists, what it never opens, and what it says of the rest."""

from __future__ import annotations

import os
import shutil
import time
from pathlib import Path

import pytest
import yaml
from foreign_bag import ride_with_times
from made_bag import PERIOD, STEPS, write_bag

from bicycle_bag.errors import BagError
from bicycle_bag.metadata import ROOT
from bicycle_bag.writer import BagWriter
from bicycle_cockpit.bags import session
from bicycle_cockpit.shelf import BagShelf, entry, signature


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("made") / "bag")


def change_metadata(bag: Path, **changes: object) -> None:
    """Give the bag's metadata other values."""
    path = bag / "metadata.yaml"
    content = yaml.safe_load(path.read_text())
    content[ROOT].update(changes)
    path.write_text(yaml.safe_dump(content))


def test_the_shelf_finds_what_lies_in_the_folder_and_nothing_else(
    bag: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "runs"
    shutil.copytree(bag, folder / "ride-1" / "bag")
    shutil.copytree(bag, folder / "a" / "b" / "c" / "too-deep")
    (folder / "notes").mkdir()
    (folder / "notes" / "readme.txt").write_text("no bag")
    outside = tmp_path / "outside"
    shutil.copytree(bag, outside)
    (folder / "link").symlink_to(outside)
    shelf = BagShelf(folder)
    assert list(shelf.found()) == ["ride-1/bag"]
    for name in ("link", "../outside", str(outside), "", ".", "ride-1", "notes"):
        with pytest.raises(KeyError):
            shelf.path(name)
    assert BagShelf(tmp_path / "nothing").found() == {}


def test_the_newest_bags_come_first(bag: Path, tmp_path: Path) -> None:
    for age, name in enumerate(("c", "a", "b")):
        shutil.copytree(bag, tmp_path / name)
        os.utime(tmp_path / name, (10**9 - age, 10**9 - age))
    assert list(BagShelf(tmp_path).found()) == ["c", "a", "b"]


def test_the_list_has_the_ride_s_own_time_not_only_that_of_the_recording(bag: Path) -> None:
    found = entry("bag", bag)
    assert found["ridden"] == pytest.approx((STEPS - 1) * PERIOD * 1e-9)
    assert found["duration"] == pytest.approx((STEPS - 1) * PERIOD * 1e-9 + 0.001)
    assert found["start"] == 1.0
    assert found["messages"] == 2 * STEPS + 6


@pytest.mark.parametrize("how", ["folder", "file"])
def test_a_bag_without_metadata_is_listed_too(bag: Path, tmp_path: Path, how: str) -> None:
    """Other programs, and a recorder killed after its file was whole, leave such a bag."""
    if how == "folder":
        shutil.copytree(bag, tmp_path / "left")
        (tmp_path / "left" / "metadata.yaml").unlink()
    else:
        (file,) = bag.glob("*.mcap")
        shutil.copy(file, tmp_path / "left.mcap")
    ((name, path),) = BagShelf(tmp_path).found().items()
    assert name == ("left" if how == "folder" else "left.mcap")
    found = entry(name, path)
    assert found["messages"] == 2 * STEPS + 6
    assert found["ridden"] == pytest.approx((STEPS - 1) * PERIOD * 1e-9)


def test_an_unfinished_bag_is_listed_with_the_remedy(bag: Path, tmp_path: Path) -> None:
    shutil.copytree(bag, tmp_path / "cut")
    (tmp_path / "cut" / "metadata.yaml").unlink()
    (file,) = (tmp_path / "cut").glob("*.mcap")
    file.write_bytes(file.read_bytes()[:2000])
    ((name, path),) = BagShelf(tmp_path).found().items()
    assert name == "cut"
    assert entry(name, path)["problem"] == "it is being written"
    an_hour_ago = time.time() - 3600.0
    os.utime(file, (an_hour_ago, an_hour_ago))
    assert "record.sh --repair" in entry(name, path)["problem"]


@pytest.mark.parametrize(
    "path", ["../../secret.mcap", "../secret.mcap", "/secret.mcap", "link.mcap"]
)
def test_a_file_outside_the_bag_that_its_metadata_names_is_not_read(
    bag: Path, tmp_path: Path, path: str
) -> None:
    folder = tmp_path / "runs"
    shutil.copytree(bag, folder / "bag")
    (secret,) = bag.glob("*.mcap")
    for place in (tmp_path, folder):
        shutil.copy(secret, place / "secret.mcap")
    (folder / "bag" / "link.mcap").symlink_to(tmp_path / "secret.mcap")
    name = str(tmp_path / "secret.mcap") if path.startswith("/") else path
    content = yaml.safe_load((folder / "bag" / "metadata.yaml").read_text())[ROOT]
    content["files"][0]["path"] = name
    change_metadata(folder / "bag", files=content["files"], relative_file_paths=[name])
    assert "problem" in entry("bag", folder / "bag")
    with pytest.raises(BagError):
        session(folder / "bag")


def test_a_name_that_is_no_text_is_listed_with_the_remedy(bag: Path, tmp_path: Path) -> None:
    """No page can ask for it."""
    shutil.copytree(bag, tmp_path / os.fsdecode(b"ride-\xff"))
    ((name, path),) = BagShelf(tmp_path).found().items()
    assert entry(name, path) == {"name": name, "problem": "its name is not UTF-8: rename it"}


def test_a_bag_without_a_message_is_listed_so(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag"):
        pass
    assert entry("bag", tmp_path / "bag") == {"name": "bag", "problem": "it holds no message"}


@pytest.mark.parametrize("number", [2**63 - 1, 2**63 + 10**18, 2**70, 2**90, -5])
def test_what_the_metadata_have_wrong_is_taken_from_the_files(
    bag: Path, tmp_path: Path, number: int
) -> None:
    shutil.copytree(bag, tmp_path / "bag")
    content = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())[ROOT]
    (file,) = content["files"]
    file["starting_time"]["nanoseconds_since_epoch"] = file["duration"]["nanoseconds"] = number
    file["message_count"] = number
    change_metadata(
        tmp_path / "bag", files=[file], storage_identifier="", topics_with_message_count=None
    )
    assert entry("bag", tmp_path / "bag") == entry("bag", bag)


def test_files_that_macos_leaves_are_no_bags(bag: Path, tmp_path: Path) -> None:
    shutil.copytree(bag, tmp_path / "bag")
    for folder in (tmp_path, tmp_path / "bag"):
        (folder / "._bag_0.mcap").write_bytes(b"\0\5\x16\7" + bytes(100))
    assert list(BagShelf(tmp_path).found()) == ["bag"]
    (tmp_path / "bag" / "metadata.yaml").unlink()
    assert entry("bag", tmp_path / "bag") == entry("bag", bag)


def test_a_start_that_no_calendar_has_is_left_out(tmp_path: Path) -> None:
    file = ride_with_times(tmp_path / "late.mcap", [(2**63 - 1,) * 2, (2**63 - 1,) * 2])
    assert entry("late", file)["start"] is None
    assert entry("late", file)["messages"] == 2


def test_a_signature_changes_with_the_bag(bag: Path, tmp_path: Path) -> None:
    shutil.copytree(bag, tmp_path / "bag")
    first = signature(tmp_path / "bag")
    assert first == signature(tmp_path / "bag")
    with (tmp_path / "bag" / "metadata.yaml").open("a") as file:
        file.write("\n")
    assert signature(tmp_path / "bag") != first
    assert signature(tmp_path / "none") == ()


def test_a_folder_of_links_in_a_circle_has_no_bags(tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    assert BagShelf(tmp_path / "loop").found() == {}
