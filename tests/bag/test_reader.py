"""The reader's own counts, times, orders and refusals; round trips are in other files."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from foreign_bag import SECOND, UNCHUNKED, ForeignFile, ride_with_times
from ride_bag import COMMAND, EPISODE, STATE, make_bag

from bicycle_bag import metadata
from bicycle_bag.errors import BagError
from bicycle_bag.metadata import NO_START, Topic
from bicycle_bag.reader import BagReader, bag_in, find_files
from bicycle_bag.writer import BagWriter

TIMES = [(7, 1), (5, 2), (9, 3), (6, 4)]
"""ns of log and publish time of four messages."""


@pytest.mark.parametrize("options", [{}, {"use_statistics": False}, UNCHUNKED])
def test_first_and_last_time_come_from_index_or_from_the_messages(
    tmp_path: Path, options: dict[str, bool]
) -> None:
    reader = BagReader(ride_with_times(tmp_path / "bag.mcap", TIMES, **options))
    assert reader.starting_time_ns == 5
    assert reader.duration_ns == 4
    assert reader.message_count == 4
    assert reader.counts == {EPISODE: 1, STATE: 2, COMMAND: 1}
    assert list(reader.moments(SECOND)) == [5, 9]


def test_a_file_without_messages_spans_nothing(tmp_path: Path) -> None:
    reader = BagReader(ride_with_times(tmp_path / "bag.mcap", [], **UNCHUNKED))
    assert (list(reader.moments(SECOND)), reader.message_count) == ([], 0)
    assert (reader.starting_time_ns, reader.duration_ns) == (NO_START, 0)


def test_moments_are_those_of_the_chunks_in_recorded_order(tmp_path: Path) -> None:
    times = [(1000 - index, index) for index in range(120)]
    reader = BagReader(ride_with_times(tmp_path / "bag.mcap", times, chunk_size=2000))
    moments = list(reader.moments(SECOND))
    spans = list(zip(moments[::2], moments[1::2], strict=True))
    assert len(spans) > 3
    assert spans == sorted(spans, reverse=True)
    assert (spans[0][1], spans[-1][0]) == (1000, 1000 - 119)
    assert all(first <= last for first, last in spans)


def test_messages_are_numbered_through_all_files(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic(Topic("/a", "x/msg/A"), "int8 a\n")
        writer.add_topic(Topic("/b", "x/msg/B"), "int8 b\n")
        for time in range(12):
            writer.write("/ab"[0] + "ab"[time % 2], bytes([time]), time, time + 100)
            writer.split()
    (tmp_path / "bag" / "metadata.yaml").unlink()
    reader = BagReader(tmp_path / "bag")
    assert [file.name for file in reader.files] == [f"bag_{n}.mcap" for n in range(13)]
    found = list(reader.messages())
    assert [(item.number, item.data[0], item.log_time_ns) for item in found] == [
        (number, number, number) for number in range(12)
    ]
    assert [item.publish_time_ns for item in found] == list(range(100, 112))
    assert [(item.topic, item.type, item.encoding) for item in found[:2]] == [
        ("/a", "x/msg/A", "cdr"),
        ("/b", "x/msg/B", "cdr"),
    ]
    assert [item.number for item in reader.messages(["/b"])] == [1, 3, 5, 7, 9, 11]
    assert reader.counts == {"/a": 6, "/b": 6}
    assert reader.metadata.files[3] == metadata.FileInformation("bag_3.mcap", 3, 0, 1)


def test_what_is_not_there_is_named_with_what_is(tmp_path: Path) -> None:
    make_bag(tmp_path / "bag", 3)
    reader = BagReader(tmp_path / "bag")
    words = f"has no topic /a, /b: it has {COMMAND}, {EPISODE}, {STATE}"
    for ask in (lambda: reader.require(["/b", "/a"]), lambda: list(reader.messages(["/a", "/b"]))):
        with pytest.raises(BagError, match=re.escape(words)):
            ask()
    with pytest.raises(BagError, match="has no topic /a"):
        reader.definition("/a")
    empty = BagWriter(tmp_path / "empty")
    empty.close()
    with pytest.raises(BagError, match="has no topic /a: it has none"):
        BagReader(tmp_path / "empty").require(["/a"])


@pytest.mark.parametrize("encoding", ["json", "abc", "cdr2", "", "CDR"])
def test_only_cdr_can_be_decoded(tmp_path: Path, encoding: str) -> None:
    make_bag(tmp_path / "bag", 3)
    reader = BagReader(tmp_path / "bag")
    kind = "bicycle_msgs/msg/BicycleState"
    reader.check_kind(STATE, kind, "cdr")
    with pytest.raises(BagError, match=f"holds {STATE} as {encoding or 'unknown'}, not cdr"):
        reader.check_kind(STATE, kind, encoding)


@pytest.mark.parametrize("kind", ["a/msg/A", "z/msg/Z", ""])
def test_only_the_first_type_of_a_topic_can_be_decoded(tmp_path: Path, kind: str) -> None:
    make_bag(tmp_path / "bag", 3)
    words = f"as bicycle_msgs/msg/BicycleState and as {kind or 'no type'}: its messages cannot"
    with pytest.raises(BagError, match=re.escape(words)):
        BagReader(tmp_path / "bag").check_kind(STATE, kind, "cdr")


def test_a_topic_of_two_channels_is_one(tmp_path: Path) -> None:
    with ForeignFile(tmp_path / "bag.mcap") as file:
        file.channel("/a", "x/msg/A", b"int8 a\n")
        file.write("/a", b"1", 1)
        file.channel("/a", "x/msg/B", b"int8 b\n", encoding="json")
        file.write("/a", b"2", 2)
    reader = BagReader(tmp_path / "bag.mcap")
    assert reader.counts == {"/a": 2}
    assert reader.topics["/a"].type == "x/msg/A"
    assert reader.definition("/a") == "int8 a\n"
    kinds = [(item.type, item.encoding) for item in reader.messages()]
    assert kinds == [("x/msg/A", "cdr"), ("x/msg/B", "json")]


def test_the_folder_of_a_ride_stands_for_its_bag_unless_it_is_one(tmp_path: Path) -> None:
    make_bag(tmp_path / "ride" / "bag", 3)
    assert bag_in(tmp_path / "ride") == tmp_path / "ride" / "bag"
    assert bag_in(tmp_path / "ride" / "bag") == tmp_path / "ride" / "bag"
    assert bag_in(tmp_path / "none") == tmp_path / "none"
    make_bag(tmp_path / "both", 3)
    make_bag(tmp_path / "both" / "bag", 3)
    assert bag_in(tmp_path / "both") == tmp_path / "both"


def test_where_no_bag_is_one_line_says_what_to_name(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for path, words in (
        (tmp_path / "none", "there is no bag .*none: name a bag directory or a .mcap file"),
        (tmp_path / "empty", "holds no .mcap file: name the directory that record.sh made"),
        (tmp_path / ("x" * 5000), r"cannot open 'x{50}'\.\.\. \(File name too long\)"),
    ):
        with pytest.raises(BagError, match=words) as raised:
            find_files(path)
        assert "\n" not in str(raised.value)


def test_a_listed_file_that_is_gone_is_named_and_the_others_can_be_found(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.split()
    (tmp_path / "bag" / "bag_0.mcap").unlink()
    with pytest.raises(BagError, match=r"lacks its file 'bag_0\.mcap': put it into that folder"):
        find_files(tmp_path / "bag")
    assert find_files(tmp_path / "bag", listed=False) == [tmp_path / "bag" / "bag_1.mcap"]
