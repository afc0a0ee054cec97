"""Topics, their order and times: the parts of recorder and player that need no ROS."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from foreign_bag import UNCHUNKED, ride_with_times
from mcap.writer import IndexType
from ride_bag import COMMAND, EPISODE, PERIOD_NS, START_NS, STATE, make_bag

from bicycle_bag.errors import BagError
from bicycle_bag.metadata import Topic
from bicycle_bag.ordering import Reorder, by_log_time
from bicycle_bag.playback import ClockTick, Playback, PlayOptions
from bicycle_bag.qos import QosProfile, adapt, dump_profiles, parse_profiles
from bicycle_bag.reader import BagMessage, BagReader
from bicycle_bag.selection import TopicFilter, echo_of, with_echoes
from bicycle_bag.writer import BagWriter


def message(log_time_ns: int, topic: str = "/a") -> BagMessage:
    return BagMessage(topic, "x/msg/X", log_time_ns, 0, b"")


@pytest.mark.parametrize(
    ("chosen", "accepted"),
    [
        (TopicFilter(), {"/a", "/bicycle/state"}),
        (TopicFilter(hidden=True), {"/a", "/bicycle/state", "/bicycle/_hidden"}),
        (TopicFilter(topics=["bicycle/state"]), {"/bicycle/state"}),
        (TopicFilter(topics=["/bicycle/_hidden"]), {"/bicycle/_hidden"}),
        (TopicFilter(regex="^/bicycle"), {"/bicycle/state"}),
        (TopicFilter(topics=["/a"], regex="state"), {"/a", "/bicycle/state"}),
        (TopicFilter(exclude_regex="state"), {"/a"}),
        (TopicFilter(exclude_topics=["a"]), {"/bicycle/state"}),
    ],
)
def test_filter(chosen: TopicFilter, accepted: set[str]) -> None:
    names = ("/a", "/bicycle/state", "/bicycle/_hidden")
    assert {name for name in names if chosen.accepts(name)} == accepted


def test_filter_by_type() -> None:
    topics = {"/a": "x/msg/A", "/b": "x/msg/B", "/_c": "x/msg/A"}

    def chosen(wanted: TopicFilter) -> set[str]:
        return {name for name, kind in topics.items() if wanted.accepts(name, kind)}

    assert chosen(TopicFilter(types=["x/msg/A"])) == {"/a"}
    assert chosen(TopicFilter(types=["x/msg/A"], topics=["b"])) == {"/a", "/b"}
    assert chosen(TopicFilter(exclude_types=["x/msg/A"])) == {"/b"}


def test_reorder_sorts_what_came_before_the_last_tick() -> None:
    order = Reorder()
    for time, topic in ((3, "/a"), (5, "/a"), (1, "/b")):
        order.push(message(time, topic))
    assert order.tick() == []
    for time, topic in ((9, "/a"), (4, "/b"), (6, "/c")):
        order.push(message(time, topic))
    assert [item.log_time_ns for item in order.tick()] == [1, 3, 4, 5]
    assert [item.log_time_ns for item in order.rest()] == [6, 9]
    assert order.rest() == []


def test_messages_by_log_time_of_topics_recorded_one_after_the_other() -> None:
    messages = [message(time, "/a") for time in range(0, 400_000_000, 25_000_000)]
    messages += [message(time, "/b") for time in range(5, 400_000_000, 25_000_000)]
    got = [item.log_time_ns for item in by_log_time(messages)]
    assert got == sorted(item.log_time_ns for item in messages)


def test_timeline_is_the_recording_s_at_a_rate(tmp_path: Path) -> None:
    make_bag(tmp_path / "bag", 40)
    playback = Playback(BagReader(tmp_path / "bag"), PlayOptions(rate=2.0, topics=[STATE]))
    due = [time for time, _ in playback.timeline()]
    first = (START_NS - BagReader(tmp_path / "bag").starting_time_ns) / 1e9
    assert due == pytest.approx([(first + 0.025 * step) / 2.0 for step in range(40)], abs=1e-9)


@pytest.mark.parametrize(
    "options",
    [{}, UNCHUNKED, {"index_types": IndexType.NONE}, {"index_types": IndexType.CHUNK}],
    ids=["indexed", "without chunks", "without index", "without index of messages"],
)
@pytest.mark.parametrize(("gaps", "jumps"), [([], False), ([50], True)])
def test_a_chunk_may_be_longer_than_a_silence(
    tmp_path: Path, options: dict[str, Any], gaps: list[int], jumps: bool
) -> None:
    """A slow topic fills a chunk of minutes; a silence in it is a silence all the same."""
    second, ahead, times = 1_000_000_000, 0, []
    for step in range(130):
        ahead += 1000 if step in gaps else 0
        times.append((START_NS + (step + ahead) * second,) * 2)
    file = ride_with_times(tmp_path / "slow.mcap", times, **options)
    playback = Playback(BagReader(file), PlayOptions())
    last = list(playback.timeline())[-1][0]
    assert playback.duration == pytest.approx(last, abs=1.5)
    assert last == pytest.approx(129.0, abs=1.5)
    assert playback.clock_jumps == jumps


def test_start_offset_and_topics(tmp_path: Path) -> None:
    make_bag(tmp_path / "bag", 40)
    options = PlayOptions(start_offset=0.5, topics=["bicycle/command"])
    items = list(Playback(BagReader(tmp_path / "bag"), options).timeline())
    assert len(items) == 20
    assert {item.topic for _, item in items if isinstance(item, BagMessage)} == {COMMAND}
    assert items[0][0] == pytest.approx(900_000e-9 + 1000e-9, abs=1e-9)


def test_clock_ticks_come_at_their_rate_and_replace_the_recorded_clock(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        for name in ("/clock", "/a"):
            writer.add_topic(Topic(name, "x/msg/X"), "")
            for step in range(5):
                writer.write(name, b"", step * PERIOD_NS, 0)
    playback = Playback(BagReader(tmp_path / "bag"), PlayOptions(rate=0.5, clock_hz=20.0))
    items = list(playback.timeline())
    ticks = [(due, item.log_time_ns) for due, item in items if isinstance(item, ClockTick)]
    assert [time for _, time in ticks] == [step * PERIOD_NS for step in range(5)]
    assert [due for due, _ in ticks] == pytest.approx([step * 0.05 for step in range(5)])
    assert playback.topics == ["/a"]


def test_what_cannot_be_played_is_named(tmp_path: Path) -> None:
    make_bag(tmp_path / "bag", 4)
    reader = BagReader(tmp_path / "bag")
    for options, said in (
        ({"topics": ["/other"]}, "has no topic"),
        ({"start_offset": 60.0}, "smaller start offset"),
        ({"rate": 0.0}, "rate is 0"),
        ({"rate": float("nan")}, "rate is nan"),
        ({"clock_hz": -1.0}, "clock hz is -1"),
    ):
        with pytest.raises(BagError, match=said):
            Playback(reader, PlayOptions(**options))
    empty_parts: list[tuple[PlayOptions, str]] = [
        (PlayOptions(start_offset=0.01, duration=1e-9), "within 1e-09 s after the start offset"),
        (PlayOptions(start_offset=0.05, topics=[EPISODE]), r"due after 0\.0 s: choose a smaller"),
    ]
    for part, said in empty_parts:
        with pytest.raises(BagError, match=said):
            list(Playback(reader, part).timeline())
    with pytest.raises(BagError, match="no message to play"):  # as in ros2 bag play
        Playback(reader, PlayOptions(topics=[STATE[1:]], exclude_topics=[STATE]))
    BagWriter(tmp_path / "empty").close()
    with pytest.raises(BagError, match="no message to play"):
        Playback(BagReader(tmp_path / "empty"), PlayOptions())
    assert EPISODE in reader.topics


def test_qos_adapts_to_the_weakest_publisher() -> None:
    latched = QosProfile(durability="transient_local")
    hasty = QosProfile(reliability="best_effort")
    assert adapt([latched]) == (True, True)
    assert adapt([latched, QosProfile()]) == (True, False)
    assert adapt([latched, hasty]) == (False, False)
    assert adapt([]) == (False, False)


def test_qos_text_comes_back_and_nonsense_is_left_out() -> None:
    profiles = (QosProfile(durability="transient_local", deadline=1_500_000_000),)
    assert parse_profiles(dump_profiles(profiles)) == profiles
    for nonsense in ("[", "- 1", "- {deadline: 3}", "- {reliability: often}", None, 7):
        assert parse_profiles(nonsense) == ()
    with pytest.raises(ValueError, match="reliability is 'often'"):
        QosProfile(reliability="often")


def test_echoes_go_with_the_states_that_they_belong_to() -> None:
    there = ["/red/bicycle/state", "/red/bicycle/command_echo", "/bicycle/state", "/odom"]
    assert with_echoes(["/odom", "/red/bicycle/state"], there) == [
        "/odom",
        "/red/bicycle/state",
        "/red/bicycle/command_echo",
    ]
    assert with_echoes(["/bicycle/state"], there) == ["/bicycle/state"]
    assert echo_of("/ghost/bicycle/state") == "/ghost/bicycle/command_echo"
    assert echo_of("/odom") == ""
