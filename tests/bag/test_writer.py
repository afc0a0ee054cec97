"""The writer's own limits, counts and places; bags read back are in test_bag_round_trip.py."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest
import yaml
from mcap.reader import make_reader

from bicycle_bag import metadata
from bicycle_bag.errors import BagError
from bicycle_bag.mcap_file import CHUNK_BYTES
from bicycle_bag.metadata import Topic
from bicycle_bag.reader import BagReader
from bicycle_bag.writer import MOST_OWED, BagWriter

TOPIC = Topic("/numbers", "x/msg/Numbers")
MESSAGE = b"\0\1\0\0" + bytes(36)


def opened(path: Path, **options: float) -> BagWriter:
    writer = BagWriter(path, **options)  # type: ignore[arg-type]
    writer.add_topic(TOPIC, "float32[9] values\n")
    return writer


def filled(writer: BagWriter, *times: int) -> None:
    for time in times:
        writer.write(TOPIC.name, MESSAGE, time, time)


@pytest.mark.parametrize(("size", "taken"), [(0, True), (1024, True), (1023, False), (1, False)])
def test_a_split_size_is_none_or_a_kibibyte_at_least(
    tmp_path: Path, size: int, taken: bool
) -> None:
    if taken:
        BagWriter(tmp_path / "bag", split_bytes=size).close()
        return
    with pytest.raises(BagError, match=f"split size is {size} bytes: choose 0 or >= 1024"):
        BagWriter(tmp_path / "bag", split_bytes=size)
    assert not (tmp_path / "bag").exists()


def test_a_split_size_below_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="split size is -1 bytes"):
        BagWriter(tmp_path / "bag", split_bytes=-1)


@pytest.mark.parametrize(
    ("seconds", "taken"),
    [(0.0, True), (1e9, True), (1e9 + 1, False), (-1e-9, False), (float("nan"), False)],
)
def test_a_split_time_is_none_to_thirty_years(tmp_path: Path, seconds: float, taken: bool) -> None:
    if taken:
        BagWriter(tmp_path / "bag", split_seconds=seconds).close()
        return
    with pytest.raises(BagError, match=r"split time is .* s: choose 0 to 1e\+09"):
        BagWriter(tmp_path / "bag", split_seconds=seconds)


def test_a_chunk_is_packed_at_32_kibibytes(tmp_path: Path) -> None:
    """Small, so that a kill of the recorder loses little; larger than a message, to pack well."""
    assert CHUNK_BYTES == 32_768
    with opened(tmp_path / "bag") as writer:
        writer._flushed = float("inf")  # no flush by time, however slow the machine is
        filled(writer, *range(2000))
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    sizes = [chunk.uncompressed_size for chunk in summary.chunk_indexes]
    whole = [size for size in sizes if size > 10_000][:-1]
    assert len(whole) >= 3
    assert all(32_768 <= size < 32_768 + 200 for size in whole)


def test_the_disk_may_owe_eight_files() -> None:
    """Each has a thread and an open file."""
    assert MOST_OWED == 8


def test_a_file_says_in_itself_what_the_bag_held_so_far(tmp_path: Path) -> None:
    """The record that a repair reads where metadata.yaml was never written."""
    with opened(tmp_path / "bag") as writer:
        for count in (3, 1, 5):
            filled(writer, *range(count))
            writer.split()
        filled(writer, 0)
    counts = []
    for file in BagReader(tmp_path / "bag").files:
        with file.open("rb") as stream:
            records = list(make_reader(stream).iter_metadata())
        last = yaml.safe_load(records[-1].metadata["serialized_metadata"])
        counts.append(last["message_count"])
        (topic,) = last["topics_with_message_count"]
        assert topic["message_count"] == counts[-1]
    assert counts == [3, 4, 9, 10]
    assert metadata.read(tmp_path / "bag").message_count == 10


@pytest.mark.parametrize("times", [(0,), (0, 0), (0, 7), (5, 2, 9)])
def test_a_bag_spans_its_log_times(tmp_path: Path, times: tuple[int, ...]) -> None:
    with opened(tmp_path / "bag") as writer:
        filled(writer, *times)
    written = metadata.read(tmp_path / "bag")
    assert written.starting_time_ns == min(times)
    assert written.duration_ns == max(times) - min(times)
    assert written.files[0].duration_ns == max(times) - min(times)


def test_what_the_kernel_has_may_be_left_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While `close` waits for a disk that hangs, the metadata are there and the file is whole."""
    began, released = threading.Event(), threading.Event()

    def stuck(_: int) -> None:
        began.set()
        released.wait()

    monkeypatch.setattr(os, "fsync", stuck)
    writer = opened(tmp_path / "bag")
    filled(writer, 1, 2, 3)
    assert writer.leave() is False
    assert not (tmp_path / "bag" / "metadata.yaml").exists()
    closing = threading.Thread(target=writer.close)
    closing.start()
    try:
        began.wait()
        while not writer.leave():  # it ends the file first
            pass
        assert metadata.read(tmp_path / "bag").message_count == 3
        assert BagReader(tmp_path / "bag").message_count == 3
    finally:
        released.set()
        closing.join()
    assert writer.leave() is True
    assert metadata.read(tmp_path / "bag").message_count == 3


def test_metadata_call_a_file_whole_only_once_the_disk_has_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    really, warned, synced = os.fsync, threading.Event(), []

    def slow(descriptor: int) -> None:
        name = Path(f"/proc/self/fd/{descriptor}").readlink().name
        if name.endswith(".mcap"):
            warned.wait(0.3)
        else:
            warned.set()
        really(descriptor)
        synced.append(name)

    monkeypatch.setattr(os, "fsync", slow)
    writer = opened(tmp_path / "bag")
    filled(writer, 1)
    writer.close()
    assert synced == ["bag_0.mcap", ".metadata.yaml.tmp", "bag"]


@pytest.mark.parametrize("instead", ["nothing", "a file", "another folder", "a folder above"])
def test_a_bag_that_is_gone_is_told_whatever_stands_there(tmp_path: Path, instead: str) -> None:
    writer = opened(tmp_path / "above" / "bag")
    filled(writer, 1)
    place = tmp_path / "above"
    if instead != "a folder above":
        place /= "bag"
    place.rename(tmp_path / "moved")
    if instead == "another folder":
        place.mkdir()
    elif instead != "nothing":
        place.write_text("")
    with pytest.raises(BagError, match=r"was moved to .* while it was being recorded") as raised:
        writer.flush()
    moved = tmp_path / "moved" / ("bag" if instead == "a folder above" else "")
    assert str(raised.value).endswith(f"record.sh --repair {moved}")
