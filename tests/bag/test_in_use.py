"""A bag that is being recorded or repaired is left alone by a second repair."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from ride_bag import TYPES, make_bag, ride, schemas

from bicycle_bag import repair
from bicycle_bag.errors import BagError
from bicycle_bag.in_use import held
from bicycle_bag.metadata import Topic
from bicycle_bag.reader import BagReader
from bicycle_bag.writer import BagWriter

KEEPS_IT_OPEN = "import sys; file = open(sys.argv[1], 'ab'); print('open', flush=True); input()"
REPAIRS_IT = (
    "import sys; from pathlib import Path; from bicycle_bag.in_use import held\n"
    "with held(Path(sys.argv[1])): print('held', flush=True); input()"
)


@contextmanager
def another(code: str, path: Path) -> Iterator[int]:
    """Let another process do something with a file, until the context ends; yields its number."""
    words = [sys.executable, "-c", code, str(path)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline()
        yield process.pid
        process.communicate(b"\n")


def recording(bag: Path) -> BagWriter:
    """Return the writer of a bag with the first half of a ride in it."""
    writer = BagWriter(bag)
    for topic, short in TYPES.items():
        kind = f"bicycle_msgs/msg/{short}"
        writer.add_topic(Topic(topic, kind), schemas().definition(kind))
    for topic, data, now in ride(50)[:50]:
        writer.write(topic, data, now, now)
    writer.flush()
    return writer


def refusal(path: Path) -> str:
    """Return the line with which a repair refuses, and check that it changes nothing."""
    folder = path if path.is_dir() else path.parent
    before = {file.name: file.read_bytes() for file in folder.iterdir() if file.is_file()}
    with pytest.raises(BagError) as raised:
        repair.repair(path)
    assert before == {file.name: file.read_bytes() for file in folder.iterdir() if file.is_file()}
    line = str(raised.value)
    assert "\n" not in line
    return line


def cut(bag: Path) -> Path:
    """Return the file of a bag, now cut off."""
    make_bag(bag, 100, chunk_bytes=2048)
    file = bag / f"{bag.name}_0.mcap"
    file.write_bytes(file.read_bytes()[:-3000])
    return file


def test_a_repair_leaves_a_bag_that_is_being_recorded_alone(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    writer = recording(bag)
    for path in (bag, bag / "bag_0.mcap"):
        assert f"process {os.getpid()} " in refusal(path)
    for topic, data, now in ride(50)[50:]:
        writer.write(topic, data, now, now)
    writer.close()
    assert [message.data for message in BagReader(bag).messages()] == [one[1] for one in ride(50)]
    assert repair.repair(bag).rewritten == []


def test_each_file_of_a_split_recording_is_let_go(tmp_path: Path) -> None:
    writer = recording(tmp_path / "bag")
    writer.split()
    assert "being written" in refusal(tmp_path / "bag")
    writer.close()
    assert repair.repair(tmp_path / "bag").messages == 50


@pytest.mark.parametrize("name", ["bag_0.mcap", "bag_0.db3"])
def test_a_recorder_without_a_lock_is_found_by_its_open_file(tmp_path: Path, name: str) -> None:
    file = cut(tmp_path / "bag")
    target = file.with_name(name)
    target.touch()
    with another(KEEPS_IT_OPEN, target) as process:
        assert f"being written by process {process} (python" in refusal(tmp_path / "bag")
        assert f"process {process} " in refusal(target)


def test_of_two_repairs_the_second_names_the_first(tmp_path: Path) -> None:
    file = cut(tmp_path / "bag")
    for first, second in ((file.parent, file.parent), (file.parent, file), (file, file)):
        with another(REPAIRS_IT, first) as process:
            assert f"repaired by process {process} (python" in refusal(second)
    assert len(repair.repair(file.parent).rewritten) == 1


def test_two_files_of_a_folder_may_be_repaired_together(tmp_path: Path) -> None:
    file = cut(tmp_path / "bag")
    other = file.with_name("other.mcap")
    other.write_bytes(file.read_bytes())
    with another(REPAIRS_IT, file):
        assert repair.repair(other).rewritten == [other]


def test_a_link_to_nowhere_and_no_bag_hide_no_recorder(tmp_path: Path) -> None:
    file = cut(tmp_path / "bag")
    file.with_name("a.mcap").symlink_to("nowhere")
    with another(KEEPS_IT_OPEN, file) as process:
        assert f"process {process} " in refusal(tmp_path / "bag")
    with held(tmp_path / "nothing"), held(Path("x" * 5000)):
        pass


def test_a_second_command_ends_with_status_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = cut(tmp_path / "bag")
    with another(REPAIRS_IT, file.parent) as process:
        assert repair.main([str(file.parent)]) == 1
    assert f"repaired by process {process}" in capsys.readouterr().err
    assert repair.main([str(file.parent)]) == 0


@pytest.mark.parametrize("is_kept", [True, False])
def test_a_recorder_tells_a_file_that_was_replaced_from_one_that_was_deleted(
    tmp_path: Path, is_kept: bool
) -> None:
    writer = recording(tmp_path / "bag")
    file, new = tmp_path / "bag" / "bag_0.mcap", tmp_path / "new"
    if is_kept:
        os.link(file, f"{file}.damaged")
    new.write_bytes(file.read_bytes())
    new.replace(file)
    with pytest.raises(BagError, match="was replaced") as raised:
        writer.flush()
    assert (f"lies in {file}.damaged" in str(raised.value)) == is_kept
