"""report.sh: real bags, whole and broken, as pages that need nothing else."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.image
import numpy as np
import pytest
from matplotlib.figure import Figure
from mcap.opcode import Opcode
from report_bag import CLOCKS, EVIL, FELL_AT, STEPS, TYPES, with_clock, write

from bicycle_bag import container
from bicycle_bag.columns import load as load_columns
from bicycle_bag.errors import BagError
from bicycle_bag.metadata import Topic
from bicycle_bag.writer import BagWriter
from bicycle_tools.drawing import STYLE, envelope
from bicycle_tools.report_page.command import main, names_of, output_of
from bicycle_tools.report_page.events import ride_events, runs
from bicycle_tools.report_page.loading import load
from bicycle_tools.report_page.page import html
from bicycle_tools.report_page.timing import LEAST_RANGE, draw_timing
from bicycle_tools.ride_report import report

VOID = {"meta", "use", "path", "circle", "rect", "image", "stop", "br", "line", "wbr"}


ALL = 2 * (4 * STEPS - 1) + 2 + 5
"""Messages in the bag: states, commands and timing, episodes, statuses."""


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("report") / "ride", chunk_bytes=4096)


class Structure(HTMLParser):
    """Checks that elements are nested, and collects what a page would load and show."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.loads: list[str] = []
        self.heads: list[str] = []
        self.names: set[str] = set()
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.names.add(tag)
        self.open += [] if tag in VOID else [tag]
        for name, value in attrs:
            if name in ("src", "href", "xlink:href") and not (value or "").startswith("#"):
                self.loads.append(str(value))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ("h2", "h3"):
            self.heads.append(data)


@pytest.fixture(scope="module")
def page(bag: Path) -> str:
    return html([load(bag, "ride")])


def test_the_page_has_every_section_and_loads_nothing(page: str) -> None:
    found = Structure(page)
    assert found.heads == [
        *("In numbers", "Look into it", "Track", "State", "Commands", "Timing"),
        *("Goals", "What happened", "Who rode, and where", "The bag"),
    ]
    assert [what for what in found.loads if not what.startswith("data:image/png")] == []
    assert len(re.findall(r"<script\b", page)) == 2, "the rides, and what draws them"
    assert "script-src 'sha256-" in page
    assert "url(http" not in page.replace("http://www.w3.org", "")
    assert page.count("<svg") == 4


def test_numbers_goals_and_events_are_those_of_the_bag(page: str) -> None:
    text = re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", page.split("<svg")[0] + page[-20000:]))
    assert "1 of 2 reached" in text
    assert "39.2" in text  # Hz: periods of 25 and 26 ms
    assert "p50 4.00 ms, p99 4.00 ms" in text
    assert "fell at (9.5, 1.0), lean 5.7°, 2.00 m/s" in text
    assert "no command: zero input for 10 steps" in text
    assert "reset: episode 2 begins" in text
    assert "a goal was rejected: its frame is &#x27;moon&#x27;" in text
    assert "made-up" in text
    assert f"policy lqr-1: {STEPS} of {2 * STEPS} commands" in text


def test_what_a_bag_says_is_never_part_of_the_page(page: str) -> None:
    assert EVIL not in page
    assert "&lt;script&gt;" in page


def test_events_come_at_their_time(bag: Path) -> None:
    found = {one.kind: one for one in ride_events(load(bag, "ride"))}
    assert found["fall"].time == pytest.approx(0.025 * FELL_AT)
    # The step that a reset makes is no ride: the axis goes on without it.
    assert found["reset"].time == pytest.approx(0.025 * (STEPS - 1))
    assert found["watchdog"].time == pytest.approx(0.025 * (STEPS - 1 + 50))
    assert found["watchdog"].until == pytest.approx(0.025 * (STEPS - 1 + 59))
    kinds = [one.kind for one in ride_events(load(bag, "ride"))]
    assert kinds.count("fall") == kinds.count("reset") == kinds.count("rejected") == 1


def test_runs_end_with_the_segment() -> None:
    flag = np.array([True, True, False, True, True, True])
    assert runs(flag, np.array([0, 0, 0, 0, 1, 1])) == [(0, 1), (3, 3), (4, 5)]
    assert runs(np.empty(0, bool), np.empty(0, np.intp)) == []


def test_an_envelope_keeps_extremes_and_order() -> None:
    time = np.arange(10_000.0)
    values = np.sin(time / 500)
    values[5000] = 40.0
    values[7000:7100] = np.inf
    thin_time, thin = envelope(time, values, 500)
    assert len(thin) <= 520
    assert (np.diff(thin_time) >= 0).all()
    assert np.nanmax(thin) == 40.0
    assert np.nanmin(thin) == pytest.approx(-1.0, abs=1e-3)
    assert not np.isinf(thin).any()


@pytest.mark.parametrize("topic", TYPES)
def test_a_bag_may_lack_any_topic(tmp_path: Path, topic: str) -> None:
    page = load(write(tmp_path / "ride", leave_out=[topic]), "ride")
    assert any(f"Nothing was recorded of {topic}" in note for note in page.notes)
    if topic == "/bicycle/state":  # a page takes a second
        text = html([page])
        assert Structure(text).heads[0] == "In numbers"
        numbers = text.partition("<h2>Track</h2>")[0]
        assert "<b>falls</b>" not in numbers, "nobody knows whether it fell"
        assert "0.0 s of simulated time" not in numbers


@pytest.mark.parametrize("left", [[], ["/bicycle/goal_status", "/bicycle/episode"]])
def test_a_bag_without_a_ride_is_one_line_and_no_page(
    tmp_path: Path, left: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """A latched message comes into a bag although no bicycle is ridden."""
    bag = write(tmp_path / "ride", leave_out=set(TYPES) - set(left))
    assert main([str(bag)]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert "holds no bicycle" in said.err
    assert list(tmp_path.glob("*.html")) == []


def test_a_bag_of_something_else_is_one_line(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "other") as writer:
        writer.add_topic(Topic("/chatter", "std_msgs/msg/String"), "string data\n")
        writer.write("/chatter", b"\0\1\0\0\2\0\0\0a\0", 5, 5)
    with pytest.raises(BagError, match="holds no bicycle"):
        load(tmp_path / "other", "other")


ABSURD: dict[str, tuple[str, dict[str, Any], str]] = {
    "infinite": (
        "/bicycle/state",
        {"rear_contact": {"x": np.inf, "y": -np.inf}, "heading": np.inf, "speed": -np.inf},
        f"{STEPS} states hold numbers that are infinite or beyond 1e+09",
    ),
    "huge": (
        "/bicycle/state",
        {"rear_contact": {"x": 1e300, "y": -1e300}, "heading": 1e308, "lean_angle": 1e300},
        f"{STEPS} states hold numbers that are infinite or beyond 1e+09",
    ),
    "a goal far away": ("/bicycle/goal_status", {"position": {"x": 1e308, "y": -1e308}}, ""),
    "no duration": ("/bicycle/timing", {"period": 0.0, "latency": 0.0}, ""),
    "an unknown status": (
        "/bicycle/goal_status",
        {"status": 200},
        "5 messages about goals are left out: their status is none of this release's",
    ),
}


@pytest.mark.parametrize("kind", ABSURD)
def test_numbers_that_no_bicycle_has_are_told_and_not_drawn(tmp_path: Path, kind: str) -> None:
    topic, absurd, told = ABSURD[kind]

    def change(name: str, fields: dict[str, Any]) -> dict[str, Any]:
        second = name != "/bicycle/state" or fields["episode"] == 2
        return fields | absurd if name == topic and second else fields

    bag = write(tmp_path / "ride", change=change)
    with np.errstate(all="ignore"):
        page = load(bag, "ride")
        assert Structure(html([page])).heads[0] == "In numbers"
    assert told in " ".join(page.notes)
    assert bool(told) == any("left out" in note or "hold" in note for note in page.notes)
    summary, text = report(bag, tmp_path)
    assert summary.falls == 1
    assert not re.search(r"\b(nan|inf)\b|\d{12}", text)
    assert summary.path_length == pytest.approx(
        0.05 * (STEPS - 1) * (1 if "heading" in absurd else 2)
    )
    json.loads((tmp_path / "summary.json").read_text(), parse_constant=pytest.fail)


def test_a_foreign_state_is_one_line(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "other") as writer:
        writer.add_topic(Topic("/bicycle/state", "std_msgs/msg/Int32"), "int32 data\n")
        writer.write("/bicycle/state", b"\0\1\0\0\2\0\0\0", 5, 5)
    with pytest.raises(BagError, match="not of this stack's types") as error:
        load(tmp_path / "other", "other")
    assert "\n" not in str(error.value)


def test_only_goals_of_this_recording_are_counted(tmp_path: Path) -> None:
    """Goal 1 was reached a minute before, goal 2 was under way, goal 3 came during the bag."""
    statuses = [
        (1, 1, -60.0, 0.0),
        (1, 2, -50.0, 0.0),
        (0, 7, -45.0, 0.0),
        (2, 1, -40.0, 0.0),
        (2, 2, 1.0, 1.0),
        (3, 1, 1.0, 1.0),
        (3, 2, 4.0, 4.0),
    ]
    page = load(write(tmp_path / "ride", statuses=statuses, late_from=7), "ride")
    found = [(goal.position[1], goal.status.name, goal.begun_before) for goal in page.outcomes]
    assert found == [(2.0, "REACHED", True), (3.0, "REACHED", False)]
    assert (page.summary.goals, page.summary.reached, page.summary.begun_before) == (2, 2, 1)
    assert page.summary.path_ratio == pytest.approx(9.9 / 9.0), "goal 3 alone"
    assert page.summary.loop.late_steps == 0, "7 were late before the recording"
    assert [one.kind for one in ride_events(page)].count("rejected") == 0
    assert any("goal at (10.0, 2.0) was under way" in note for note in page.notes)
    assert any("3 messages about goals from before" in note for note in page.notes)
    text = html([page])
    assert "2 of 2 goals reached" in text
    assert "under way when the recording began" in text


def test_a_goal_that_is_not_over_at_the_end_is_no_failure(tmp_path: Path) -> None:
    page = load(write(tmp_path / "ride", statuses=[(1, 1, -5.0, 0.0)]), "ride")
    assert (page.summary.goals, page.summary.open, page.summary.decided) == (1, 1, 0)
    text = html([page])
    assert '<span class="chip">0 of 1 goals reached</span>' in text
    assert "0 of 1 reached, 1 without an end in the bag" in text


def test_commands_of_a_second_controller_are_no_part_of_the_ride(tmp_path: Path) -> None:
    page = load(write(tmp_path / "ride", second_controller=True), "ride")
    assert page.summary.policies == ("lqr-1", EVIL)
    assert any(f"{2 * STEPS} commands are left out" in note for note in page.notes)
    assert len(page.log.commands["step"]) == 2 * STEPS


def test_axes_show_values_and_no_offset(bag: Path) -> None:
    """An axis with "+4e1" above ticks of 0.0025 cannot be read."""
    with mpl.rc_context(STYLE):
        figure = Figure()
        pages = [load(bag, "ride"), load(bag, "ride")]
        draw_timing(figure, pages)
        figure.draw_without_rendering()
    for axes in figure.axes:
        assert axes.yaxis.get_offset_text().get_text() == ""
        assert axes.xaxis.get_offset_text().get_text() == ""
    rate = figure.axes[0]
    assert rate.get_ylabel() == "rate (Hz)"
    low, high = rate.get_ylim()
    assert high - low >= LEAST_RANGE
    assert low < 39.2 < high


def chunk_ends(file: Path) -> list[int]:
    """Return the end of each chunk of messages."""
    with file.open("rb") as stream:
        stream.read(len(container.MAGIC))
        found = list(container.records(stream, file.stat().st_size))
    return [at + 9 + len(item.body) for at, item in found if item.opcode == Opcode.CHUNK]


@pytest.mark.parametrize("damage", ["cut", "index", "flip"])
def test_a_damaged_bag_is_shown_as_far_as_it_goes(bag: Path, tmp_path: Path, damage: str) -> None:
    shutil.copytree(bag, tmp_path / "ride")
    file = tmp_path / "ride" / "ride_0.mcap"
    data = bytearray(file.read_bytes())
    ends = chunk_ends(file)
    if damage == "flip":
        data[ends[1] - 20] ^= 0xFF
    else:
        del data[ends[2] + 40 if damage == "cut" else -60 :]
        (tmp_path / "ride" / "metadata.yaml").unlink()
    file.write_bytes(data)
    for path in (tmp_path / "ride", file):
        page = load(path, "ride")
        assert "not whole" in page.notes[0]
        count = page.contents.message_count
        assert count == ALL if damage == "index" else 0 < count < ALL
        assert ("lost" in page.notes[0]) == (damage != "index")
    assert file.read_bytes() == bytes(data)
    assert [path.name for path in (tmp_path / "ride").glob("*.damaged")] == []


def test_one_of_several_bicycles_is_chosen(tmp_path: Path) -> None:
    fleet = write(tmp_path / "fleet", namespaces=("/red", "/blue"))
    with pytest.raises(BagError, match="several bicycles: choose --namespace of /blue, /red"):
        load(fleet, "fleet")
    assert load(fleet, "fleet", "red").summary.goals == 2
    with pytest.raises(BagError, match="no bicycle /green: it has /blue, /red"):
        load(fleet, "fleet", "green")


def test_times_of_a_ride_without_states_count_from_the_bags_start(tmp_path: Path) -> None:
    page = load(write(tmp_path / "ride", leave_out=["/bicycle/state"]), "ride")
    times = page.time_of(load_columns(tmp_path / "ride", "/bicycle/command"))
    assert times[0] == pytest.approx(0.0, abs=1e-6)
    assert times[-1] == pytest.approx(0.025 * (2 * STEPS - 1), abs=1e-6)


@pytest.mark.parametrize("publishers", [False, True])
@pytest.mark.parametrize("name", CLOCKS)
def test_the_recordings_clock_does_not_matter(
    bag: Path, tmp_path: Path, name: str, publishers: bool
) -> None:
    """Set back, set ahead, standing still: the page tells the same ride."""
    other = load(with_clock(bag, tmp_path / "bag", CLOCKS[name], publishers), "ride")
    sound = load(bag, "ride")
    assert ride_events(other) == ride_events(sound)
    assert list(other.ends_of(other.outcomes)) == list(sound.ends_of(sound.outcomes))
    untimed = [[replace(goal, known_at=0.0) for goal in p.outcomes] for p in (other, sound)]
    assert untimed[0] == untimed[1]
    assert "1 of 2 goals reached" in html([other])


def test_two_bags_stand_side_by_side_on_the_page_and_the_picture(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(bag, tmp_path / "<i>other")
    target = tmp_path / "both.html"
    assert main([str(bag), str(tmp_path / "<i>other"), "--png", "--output", str(target)]) == 0
    written = capsys.readouterr().out.splitlines()
    assert written == [str(tmp_path / "both.html"), str(tmp_path / "both.png")]
    found = Structure(target.read_text())
    assert found.heads.count("ride") == found.heads.count("<i>other") == 4
    assert "i" not in found.names
    image = matplotlib.image.imread(tmp_path / "both.png")
    assert image.shape[1] == 14 * 130
    assert (image[..., :3] < 0.9).any(axis=-1).mean() > 0.02
    assert not list(tmp_path.glob(".*"))


def test_names_tell_bags_apart(tmp_path: Path) -> None:
    assert names_of([Path("/a/ride")]) == ["ride"]
    assert names_of([Path("/a/bag")]) == ["a/bag"]
    assert names_of([Path("/a/bag"), Path("/b/bag")]) == ["a/bag", "b/bag"]
    paths = [Path("/runs/a/bag"), Path("/runs/b.mcap")]
    assert names_of(paths) == ["a/bag", "runs/b.mcap"]
    assert output_of(paths, names_of(paths)) == Path("/runs/a/a-bag-and-runs-b-report.html")


def test_a_runs_folder_stands_for_its_bag(bag: Path, tmp_path: Path) -> None:
    shutil.copytree(bag, tmp_path / "run" / "bag")
    assert load(tmp_path / "run", "run").summary.goals == 2


@pytest.mark.parametrize(
    ("words", "status", "complaint"),
    [
        (["/none"], 1, "there is no bag /none"),
        ([], 2, "required: bags"),
        (["a", "b", "c"], 2, "3 bags do not fit on a page"),
        (["a", "--output", "x.pdf"], 2, "ends in .html"),
        (["BAG", "--output", "/none/x.html"], 1, "there is no folder /none"),
    ],
)
def test_a_mistake_is_one_line(
    bag: Path,
    words: list[str],
    status: int,
    complaint: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    try:
        found = main([word.replace("BAG", str(bag)) for word in words])
    except SystemExit as end:
        found = int(str(end.code))
    said = capsys.readouterr().err
    assert (found, said.count("\n")) == (status, 1), said
    assert complaint in said


def test_links_in_a_circle_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    assert main([str(tmp_path / "loop")]) == 1
    assert "there is no bag" in capsys.readouterr().err
