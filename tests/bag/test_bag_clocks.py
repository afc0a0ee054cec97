"""The recording's clock is set back, set ahead, stands still or is nonsense: the order holds."""

from __future__ import annotations

import random
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from busy_machine import UNHURRIED
from foreign_bag import SECOND, UNCHUNKED, ride_with_times
from hypothesis import given, settings
from hypothesis import strategies as st
from ride_bag import PERIOD_NS, STATE, make_bag, ride

from bicycle_bag import columns, ordering
from bicycle_bag.errors import BagError
from bicycle_bag.ordering import MOST_HELD, Reorder, by_log_time
from bicycle_bag.play_time import PlayTime, span, with_standing_clocks
from bicycle_bag.playback import ClockTick, Playback, PlayOptions
from bicycle_bag.reader import BagMessage, BagReader

HOUR = 3600 * SECOND
NOW = 1_700_000_000 * SECOND
STEP = PERIOD_NS // 2
"""ns between two messages of the made-up bags."""


def message(log_ns: int, topic: str = "/a", publish_ns: int = 0) -> BagMessage:
    return BagMessage(topic, "x/msg/X", log_ns, publish_ns, b"")


def played(
    path: Path, options: PlayOptions | None = None
) -> tuple[list[float], list[tuple[str, bytes]], list[str]]:
    """Return when each message is due, the messages, and the lines about the bag's clock."""
    lines: list[str] = []
    items = list(Playback(BagReader(path), options or PlayOptions()).timeline(lines.append))
    messages = [item for _, item in items if isinstance(item, BagMessage)]
    return [due for due, _ in items], [(m.topic, m.data) for m in messages], lines


def recorded(count: int) -> list[tuple[str, bytes]]:
    return [(topic, data) for topic, data, _ in ride((count + 1) // 2)[:count]]


def regular(count: int) -> list[float]:
    return [number * STEP / SECOND for number in range(count)]


@pytest.mark.parametrize("options", [{"chunk_size": 1000}, UNCHUNKED], ids=["chunks", "none"])
def test_a_clock_that_is_set_back_by_an_hour(tmp_path: Path, options: dict[str, bool]) -> None:
    """The system's clock, which stamps both times."""
    log = [NOW + STEP * n - (HOUR if n >= 60 else 0) for n in range(100)]
    bag = ride_with_times(tmp_path / "bag.mcap", [(time, time) for time in log], **options)
    due, messages, lines = played(bag)
    assert messages == recorded(100), "in recorded order, nothing left out"
    # The step at which it was set is lost, no more.
    assert due == pytest.approx(
        [*regular(60), *(time - STEP / SECOND for time in regular(100)[60:])]
    )
    assert len(lines) == 1
    assert "goes back by 3600.0 s after 0.7 s" in lines[0]


def test_first_messages_at_log_time_zero(tmp_path: Path) -> None:
    """Make a bag as with --use-sim-time before the first /clock: the system's publish times."""
    log = [0 if n < 20 else NOW + STEP * n for n in range(100)]
    times = [(time, NOW + STEP * n) for n, time in enumerate(log)]
    due, messages, lines = played(ride_with_times(tmp_path / "bag.mcap", times))
    assert messages == recorded(100)
    assert max(due) < 2.0, "nobody waits for 53 years"
    assert due[20:] == pytest.approx([due[20] + time for time in regular(80)])
    assert len(lines) == 1
    assert "53.9 years" in lines[0]


@pytest.mark.parametrize("still", [0, NOW, 2**63 - 1, 2**64 - 1])
def test_a_clock_that_stands_still(tmp_path: Path, still: int) -> None:
    times = [(still, NOW + STEP * n) for n in range(400)]
    due, messages, lines = played(ride_with_times(tmp_path / "bag.mcap", times))
    assert messages == recorded(400)
    # A topic's first message has none before it to be paced by.
    assert due == pytest.approx(regular(400), abs=3 * STEP / SECOND), "paced by the publishers"
    assert ["stands still" in line for line in lines] == [True]


def test_a_clock_that_stands_still_and_goes_on(tmp_path: Path) -> None:
    log = [NOW + STEP * min(n, max(100, n - 200)) for n in range(400)]
    times = [(time, NOW + STEP * n) for n, time in enumerate(log)]
    due, messages, lines = played(ride_with_times(tmp_path / "bag.mcap", times))
    assert messages == recorded(400)
    assert due == pytest.approx(regular(400), abs=2 * STEP / SECOND)
    assert len(lines) == 1


def test_steps_of_simulated_time_are_no_clock_that_stands_still(tmp_path: Path) -> None:
    """A slow simulator: ten messages of one log time take it 3 s to publish."""
    times = [(PERIOD_NS * (n // 10), NOW + 300_000_000 * n) for n in range(200)]
    due, _, lines = played(ride_with_times(tmp_path / "bag.mcap", times))
    assert due == pytest.approx([0.025 * (n // 10) for n in range(200)])
    assert lines == []


def test_a_log_time_that_runs_backwards(tmp_path: Path) -> None:
    times = [(NOW - 10 * SECOND * n, NOW + STEP * n) for n in range(100)]
    due, messages, lines = played(ride_with_times(tmp_path / "bag.mcap", times))
    assert messages == recorded(100)
    assert due == sorted(due)
    assert max(due) == pytest.approx(regular(100)[-1], abs=0.1), "paced by the publishers"
    assert len(lines) == 99
    assert {line.split(" after")[0] for line in lines} == {
        "the recording's clock goes back by 10.0 s"
    }


@pytest.mark.parametrize("years", [1, 300, 560])
def test_a_clock_that_jumps_ahead_by_years(tmp_path: Path, years: int) -> None:
    """Also beyond 2262, where 63 bits end."""
    ahead = min(int(years * 31_557_600 * SECOND), 2**64 - 1 - NOW - 100 * STEP)
    log = [NOW + STEP * n + (ahead if n >= 50 else 0) for n in range(100)]
    bag = ride_with_times(tmp_path / "bag.mcap", [(time, time) for time in log])
    due, messages, lines = played(bag)
    assert messages == recorded(100)
    assert max(due) < 2.0
    assert len(lines) == 1
    table = columns.load(bag, STATE)
    assert (table["log_time"] >= 0).all()
    assert table["log_time"][-1] == pytest.approx(log[-1] / SECOND, abs=0.1)


def test_a_topic_with_a_clock_of_its_own(tmp_path: Path) -> None:
    times = []
    for n in range(200):
        own = STEP * n if ride(100)[n][0] == STATE else NOW + STEP * n
        times.append((own, own))
    due, messages, lines = played(ride_with_times(tmp_path / "bag.mcap", times))
    assert messages == recorded(200)
    assert due == pytest.approx(regular(200), abs=2 * STEP / SECOND)
    assert len(lines) <= 2


def test_a_topic_whose_clock_is_half_a_minute_ahead(tmp_path: Path) -> None:
    """Taken for a silence once, not each time that the topics alternate."""
    times = []
    for n in range(200):
        ahead = 30 * SECOND if ride(100)[n][0] == STATE else 0
        times.append((NOW + STEP * n + ahead, NOW + STEP * n + ahead))
    due, messages, lines = played(ride_with_times(tmp_path / "bag.mcap", times))
    assert messages == recorded(200)
    assert due[-1] < 30.0 + regular(200)[-1] + 1.0
    assert len(lines) <= 2


@pytest.mark.parametrize("seed", range(3))
def test_publish_times_that_are_nonsense_change_nothing(tmp_path: Path, seed: int) -> None:
    draw = random.Random(seed)
    times = [
        (NOW + STEP * n, draw.choice([0, 2**64 - 1, draw.randrange(2**64)])) for n in range(100)
    ]
    due, messages, lines = played(ride_with_times(tmp_path / "bag.mcap", times))
    assert messages == recorded(100)
    assert due == pytest.approx(regular(100))
    assert lines == []


def test_a_silence_is_waited_for_and_a_longer_one_is_told(tmp_path: Path) -> None:
    log = [NOW + STEP * n + (50 * SECOND if n >= 50 else 0) for n in range(100)]
    bag = ride_with_times(tmp_path / "bag.mcap", [(time, time) for time in log])
    waited, _, lines = played(bag)
    assert waited[-1] == pytest.approx(50.0 + regular(100)[-1])
    assert lines == []
    left_out, _, lines = played(bag, PlayOptions(max_gap=10.0))
    assert left_out[-1] == pytest.approx(regular(100)[-1], abs=0.1)
    assert len(lines) == 1
    assert "nothing was recorded for 50.0 s" in lines[0]
    assert "--max-gap" in lines[0]


def test_the_length_leaves_jumps_out(tmp_path: Path) -> None:
    log = [NOW + STEP * n - (HOUR if n >= 60 else 0) for n in range(400)]
    path = tmp_path / "bag.mcap"
    reader = BagReader(ride_with_times(path, [(t, t) for t in log], chunk_size=500))
    playback = Playback(reader, PlayOptions())
    assert playback.clock_jumps
    assert playback.duration == pytest.approx(regular(400)[-1], abs=0.3)
    make_bag(tmp_path / "sound", 100)
    sound = Playback(BagReader(tmp_path / "sound"), PlayOptions())
    assert not sound.clock_jumps
    assert sound.duration == pytest.approx(BagReader(tmp_path / "sound").duration_ns / 1e9)


def test_the_start_offset_counts_what_is_played(tmp_path: Path) -> None:
    log = [NOW + STEP * n - (HOUR if n >= 60 else 0) for n in range(100)]
    bag = ride_with_times(tmp_path / "bag.mcap", [(time, time) for time in log])
    due, messages, _ = played(bag, PlayOptions(start_offset=1.0))
    assert messages == recorded(100)[81:]
    assert due[0] == pytest.approx(0.0, abs=0.02)
    with pytest.raises(BagError, match=r"due after 1\.2 s: choose a smaller start offset"):
        played(bag, PlayOptions(start_offset=5.0))


def test_the_clock_topic_follows_the_recordings_clock(tmp_path: Path) -> None:
    log = [NOW + STEP * n - (HOUR if n >= 60 else 0) for n in range(120)]
    bag = ride_with_times(tmp_path / "bag.mcap", [(time, time) for time in log])
    items = Playback(BagReader(bag), PlayOptions(clock_hz=100.0)).timeline()
    ticks = [(due, item.log_time_ns) for due, item in items if isinstance(item, ClockTick)]
    assert [due for due, _ in ticks] == pytest.approx([n / 100 for n in range(len(ticks))])
    steps = [after - before for (_, before), (_, after) in pairwise(ticks)]
    assert sum(step != SECOND // 100 for step in steps) == 1
    assert min(steps) == pytest.approx(-HOUR, abs=SECOND)


TIMES = st.integers(0, 2**64 - 1) | st.integers(NOW, NOW + 10 * SECOND) | st.just(0)


@settings(UNHURRIED, max_examples=200)
@given(st.lists(st.tuples(TIMES, TIMES, st.sampled_from(["/a", "/b", "/c"])), max_size=60))
def test_whatever_the_times_are_all_is_played_and_nobody_waits_long(
    times: list[tuple[int, int, str]],
) -> None:
    messages = [message(log, topic, published) for log, published, topic in times]
    time = PlayTime(60 * SECOND)
    due = [time.due(*item) for item in with_standing_clocks(by_log_time(messages))]
    assert len(due) == len(messages)
    assert due == sorted(due)
    assert all(after - before <= 60 * SECOND for before, after in pairwise([0, *due]))


@UNHURRIED
@given(st.lists(st.tuples(st.integers(0, 5 * SECOND), st.sampled_from("ab")), max_size=40))
def test_a_sound_clock_is_followed_to_the_nanosecond(steps: list[tuple[int, str]]) -> None:
    now, times = NOW, []
    for step, _ in steps:
        now += step
        times.append(now)
    time = PlayTime(60 * SECOND, start_ns=NOW)
    pairs = zip(times, steps, strict=True)
    assert [time.due(message(log, topic)) for log, (_, topic) in pairs] == [
        log - NOW for log in times
    ]


@pytest.mark.parametrize("kind", ["descending", "standing", "ascending", "zigzag", "ahead once"])
def test_what_is_held_in_memory_is_bounded(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ordering, "MOST_HELD", 500)
    count = 5_000
    times = {
        "descending": range(NOW, NOW - count, -1),
        "standing": [NOW] * count,
        "ascending": range(NOW, NOW + count),
        "zigzag": [NOW + (number % 2) * HOUR for number in range(count)],
        "ahead once": [2**64 - 1, *range(NOW, NOW + count - 1)],
    }[kind]
    taken = 0

    def messages() -> Iterator[BagMessage]:
        nonlocal taken
        for time in times:
            taken += 1
            yield message(time)

    most = given_out = 0
    for _ in by_log_time(messages()):
        given_out += 1
        most = max(most, taken - given_out)
    assert given_out == count
    assert most <= 501
    assert MOST_HELD <= 50_000


def test_large_messages_are_not_held_by_the_thousand(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ordering, "MOST_HELD_BYTES", 10_000)
    large = [BagMessage("/a", "x/msg/X", NOW, 0, bytes(1000)) for _ in range(100)]
    pulled = 0

    def messages() -> Iterator[BagMessage]:
        nonlocal pulled
        for one in large:
            pulled += 1
            yield one

    next(by_log_time(messages()))
    assert pulled <= 12


def test_a_recorder_keeps_each_topics_order_when_its_clock_is_set_back() -> None:
    """The messages from before and after arrive within one tick of the recorder."""
    order = Reorder()
    sent = [(topic, n) for n in range(8) for topic in ("/a", "/b")]
    for topic, n in sent:
        time = NOW + STEP * n - (HOUR if n >= 4 else 0)
        order.push(BagMessage(topic, "x/msg/X", time, n, b""))
    written = [*order.tick(), *order.tick(), *order.rest()]
    assert [(item.topic, item.publish_time_ns) for item in written] == sent


def test_a_recorder_goes_on_sorting_after_its_clock_was_set_back() -> None:
    order = Reorder()
    order.push(message(NOW + HOUR, "/a"))
    order.push(message(NOW, "/a"))
    order.tick()
    for time, topic in ((3, "/a"), (2, "/b"), (1, "/c")):
        order.push(message(NOW + time, topic))
    written = [*order.tick(), *order.tick(), *order.rest()]
    assert [item.log_time_ns - NOW for item in written] == [HOUR, 0, 1, 2, 3]


def test_spans_of_time_are_said_as_people_do() -> None:
    said = [span(int(seconds * SECOND)) for seconds in (0.25, 3600, 7200, 200_000, 1.7e9)]
    assert said == ["0.2 s", "3600.0 s", "2.0 hours", "2.3 days", "53.9 years"]
