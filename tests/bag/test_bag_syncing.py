"""A disk that takes its time, and one that is really full."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from syncing import noted_syncs
from waiting import PATIENCE

from bicycle_bag import repair
from bicycle_bag.errors import BagError
from bicycle_bag.metadata import Topic
from bicycle_bag.reader import BagReader
from bicycle_bag.writer import MOST_OWED, BagWriter

TOPIC = Topic("/numbers", "x/msg/Numbers")
MESSAGE = b"\0\1\0\0" + bytes(512)


def opened(path: Path) -> BagWriter:
    writer = BagWriter(path, compression="none", chunk_bytes=1000)
    writer.add_topic(TOPIC, "float64[64] values\n")
    return writer


def write_on(writer: BagWriter, most: int) -> None:
    """Write numbered messages and flush after each."""
    for number in range(most):
        writer.write("/numbers", MESSAGE, number, number)
        writer.flush()


def test_a_slow_disk_keeps_no_message_out_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    released, began = threading.Event(), threading.Event()

    def stuck(descriptor: int) -> None:
        began.set()
        assert released.wait(PATIENCE)

    monkeypatch.setattr(os, "fdatasync", stuck)
    writer = opened(tmp_path / "bag")
    writer.flush()
    assert began.wait(PATIENCE)
    for time in range(50):
        writer.write("/numbers", MESSAGE, time, time)
    writer.flush()
    # What a killed process leaves behind is what the kernel has.
    shutil.copytree(tmp_path / "bag", tmp_path / "killed")
    released.set()
    writer.close()
    assert BagReader(tmp_path / "bag").message_count == 50
    (tmp_path / "killed" / "bag_0.mcap").rename(tmp_path / "killed" / "killed_0.mcap")
    assert repair.repair(tmp_path / "killed").messages == 50


def test_a_finished_bag_is_on_the_disk_before_it_is_called_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A power cut at the end loses nothing: all is synced, the names in the folder last."""
    synced = noted_syncs(monkeypatch)
    writer = opened(tmp_path / "bag")
    write_on(writer, 10)
    writer.split()
    write_on(writer, 10)
    writer.close()
    files = {path.name: path.read_bytes() for path in (tmp_path / "bag").iterdir()}
    # Each file has a thread of its own; metadata.yaml calls them whole.
    assert sorted(synced[:2], key=lambda one: one[0]) == [
        ("bag_0.mcap", files["bag_0.mcap"]),
        ("bag_1.mcap", files["bag_1.mcap"]),
    ]
    assert synced[2:] == [
        (".metadata.yaml.tmp", files["metadata.yaml"]),
        ("bag", sorted(files)),
    ]


def test_a_sync_that_fails_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    failed = threading.Event()

    def broken(descriptor: int) -> None:
        failed.set()
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "fdatasync", broken)
    writer = opened(tmp_path / "bag")
    with pytest.raises(BagError, match=r"Input/output error.*check the disk"):
        fail_on(writer, failed)


def fail_on(writer: BagWriter, failed: threading.Event) -> None:
    """Write until the failed sync is told, at the flush where the disk was quick to fail."""
    writer.flush()
    assert failed.wait(PATIENCE)
    write_on(writer, 10**6)


def test_a_new_file_begins_while_the_disk_still_takes_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    released = threading.Event()
    for name in ("fsync", "fdatasync"):
        monkeypatch.setattr(os, name, lambda _: released.wait(PATIENCE))
    writer = opened(tmp_path / "bag")
    for number in range(5):
        writer.write("/numbers", MESSAGE, number, number)
        writer.split()
    # Each has its footer before the disk has taken anything.
    files = sorted((tmp_path / "bag").glob("*.mcap"))
    assert [file.read_bytes().endswith(b"\x89MCAP0\r\n") for file in files] == 5 * [True] + [False]
    released.set()
    writer.close()
    assert BagReader(tmp_path / "bag").message_count == 5


def test_a_disk_that_owes_many_files_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    released, split = threading.Event(), threading.Event()
    monkeypatch.setattr(os, "fsync", lambda _: released.wait(PATIENCE))
    writer = opened(tmp_path / "bag")
    for _ in range(MOST_OWED):
        writer.split()
    threads = threading.active_count()

    def split_once_more() -> None:
        writer.split()
        split.set()

    one_more = threading.Thread(target=split_once_more)
    one_more.start()
    assert not split.wait(0.2)
    assert threading.active_count() <= threads + 1
    released.set()
    one_more.join(PATIENCE)
    writer.close()
    assert len(BagReader(tmp_path / "bag").files) == MOST_OWED + 2


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """Yield a file system of 256 KiB."""
    place = tmp_path / "disk"
    place.mkdir()
    words = ["mount", "-t", "tmpfs", "-o", "size=256k", "small", str(place)]
    if os.geteuid() != 0 or shutil.which("mount") is None:
        pytest.skip("a small disk needs root and mount")
    done = subprocess.run(words, capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"no small disk: {done.stderr.strip()}")
    yield place
    subprocess.run(["umount", "--lazy", str(place)], check=True)


def test_a_disk_that_is_really_full(disk: Path) -> None:
    ballast = disk / "ballast"
    ballast.write_bytes(bytes(120_000))
    writer = opened(disk / "bag")
    with pytest.raises(BagError, match=r"No space left on device.*free some space") as raised:
        write_on(writer, 1000)
    assert "\n" not in str(raised.value)
    # 512 bytes each, and the chunk that was being packed is lost.
    room = (256 * 1024 - len(ballast.read_bytes())) // 600
    # Repair writes a new file beside the old one: on the full disk it says so and changes nothing.
    before = (disk / "bag" / "bag_0.mcap").read_bytes()
    with pytest.raises(BagError, match="No space left on device"):
        repair.repair(disk / "bag")
    assert (disk / "bag" / "bag_0.mcap").read_bytes() == before
    ballast.unlink()
    report = repair.repair(disk / "bag")
    assert room / 2 <= report.messages <= 1.2 * room
    assert [message.log_time_ns for message in BagReader(disk / "bag").messages()] == list(
        range(report.messages)
    )
