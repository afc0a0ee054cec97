"""Faults that people met on the page, each by its name, in a real browser over a real ride."""

from __future__ import annotations

import itertools
import math
import os
import re
import signal
import socket
from collections.abc import Iterator
from functools import partial
from typing import Any

import pytest
import waiting
from chromium import (
    BrowserContext,
    BrowserPage,
    Page,
    Started,
    chromium,
    cockpit,
    drawn,
    expect,
    inside,
    opened,
    place,
    position,
    ridden,
    said,
    saw,
    told,
    until,
)
from cockpit_page import COCKPIT

from bicycle_cockpit.ride_state import HISTORY
from bicycle_cockpit.riders import label

pytestmark = [pytest.mark.ros, pytest.mark.slow]

WIDTHS = (320, 360, 390, 500, 640, *range(641, 1060, 20), 1100, 1280, 1440)
RELOADS = 12


@pytest.fixture(scope="module")
def browser() -> Iterator[BrowserContext]:
    """Yield a Chromium."""
    with chromium() as context:
        yield context


@pytest.fixture(scope="module")
def started(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Started]:
    """Yield a cockpit with its own ride."""
    folder = tmp_path_factory.mktemp("bags")
    with cockpit("--bags", str(folder), "controller.policy:=lqr") as result:
        yield result


@pytest.fixture
def page(browser: BrowserContext, started: Started) -> Iterator[BrowserPage]:
    """Yield the page, with a bicycle that waits at the origin."""
    with opened(browser, started[0]) as result:
        result.set_viewport_size({"width": 1280, "height": 800})
        expect(result.locator("#controller")).not_to_have_value("")
        if result.locator("#pause").inner_text().endswith("Go on"):
            result.locator("#pause").click()
        result.locator("#reset").click()
        expect(result.locator("#mode")).to_have_text("waits for a goal")
        yield result


@pytest.fixture
def other(started: Started) -> Iterator[Page]:
    """Yield a page without a browser."""
    result = Page(started[0])
    yield result
    result.close()


def ride(page: BrowserPage, across: float = 0.8, down: float = 0.3) -> None:
    """Send the bicycle somewhere."""
    page.mouse.click(*place(page, across, down))
    expect(page.locator("#mode")).to_have_text("riding")


def fall(page: BrowserPage, other: Page) -> tuple[float, float]:
    """Push until it falls; returns where it lies."""
    other.until(lambda: other.ask("push", lean_rate=2.0)["ok"] is False)
    expect(page.locator("#mode")).to_have_text("fallen")
    return position(page)


def whole(page: BrowserPage) -> None:
    """Wait until the page has all rows that it gets when it comes, of two minutes at most."""
    all_rows = f"(live.series.first === 0 || live.series.length >= {HISTORY})"
    until(page, f"live.greeted && live.series.length > 0 && {all_rows}")


def steps_of(page: BrowserPage) -> list[tuple[int, int]]:
    """Episode and step of every row that the page has."""
    rows = inside(page, "[[...live.series.episode], [...live.series.step]]")
    return list(zip(*rows, strict=True))


def hole(rows: list[tuple[int, int]]) -> Any:
    """Return the first two rows that do not follow each other; None where all do."""
    for before, after in itertools.pairwise(rows):
        goes_on = after == (before[0], before[1] + 1)
        if not goes_on and not (after[0] > before[0] and after[1] == 0):
            return before, after
    return None


# The history.


def test_a_reload_keeps_the_history_without_a_row_lost_or_twice(page: BrowserPage) -> None:
    ride(page)
    page.locator("#push-right").click()
    said(page, "^pushed to the right$")
    seen = (0, 0)
    for _ in range(RELOADS):
        page.reload()
        whole(page)
        rows = steps_of(page)
        assert hole(rows) is None
        assert rows[-1] > seen, "what was seen before is there again, and more"
        seen = rows[-1]
        kinds = inside(page, "live.marks.map(({ kind }) => kind)")
        assert "push" in kinds


def test_a_second_browser_has_the_same_history(page: BrowserPage, started: Started) -> None:
    ride(page)
    ridden(page, 60)
    second = page.context.new_page()
    second.goto(started[0])
    whole(second)
    first_rows = steps_of(page)
    until(second, f"live.series.next >= {inside(page, 'live.series.next')}")
    second_rows = steps_of(second)
    second.close()
    assert hole(second_rows) is None
    assert {row for row in first_rows if row >= second_rows[0]} <= set(second_rows)


def test_a_page_whose_connection_was_lost_has_no_hole_when_it_is_back(page: BrowserPage) -> None:
    ride(page)
    for _ in range(4):
        before = steps_of(page)
        inside(page, "link.socket.close()")
        said(page, "^connected again$")
        whole(page)
        after = steps_of(page)
        assert hole(after) is None
        assert after[: len(before)] == before
        ridden(page, 10)


def test_rows_that_come_twice_are_taken_once_and_older_ones_only_where_they_fit(
    page: BrowserPage,
) -> None:
    """Should a server or a proxy ever repeat a message."""
    found = page.evaluate(
        """async () => {
            const { Series } = await import("/web/series.js");
            const rows = (a, b) => Array.from({ length: b - a }, (_, n) => [a + n]);
            const series = new Series(["t"], 10);
            series.push(rows(10, 14), 10);
            series.push(rows(12, 16), 12);
            series.push(rows(10, 12), 10);
            const fits = [series.prepend(rows(2, 9), 2), series.prepend(rows(6, 10), 6)];
            series.push(rows(18, 20), 18);
            return { fits, t: series.t, first: series.first, next: series.next };
        }"""
    )
    assert found["fits"] == [False, True]
    assert found["t"] == [*range(6, 16), 18, 19]
    assert (found["first"], found["next"]) == (6, 20)


# What is shown, and where.


def overlaps(page: BrowserPage) -> list[str]:
    """Parts of the head that lie over each other or beyond its edges."""
    found: list[str] = page.evaluate(
        """() => {
            const head = document.querySelector("header").getBoundingClientRect();
            const parts = [...document.querySelectorAll(
                "header h1, #mode, .facts dt, .facts dd, .source button, #help, #who-text")]
                .map((element) => [element.id || element.textContent,
                    element.getBoundingClientRect()])
                .filter(([, box]) => box.width > 0);
            const bad = [];
            parts.forEach(([name, a], index) => {
                if (a.left < -0.5 || a.right > innerWidth + 0.5) bad.push(`${name} is cut off`);
                if (a.bottom > head.bottom + 0.5) bad.push(`${name} leaves the head`);
                for (const [other, b] of parts.slice(index + 1)) {
                    const across = Math.min(a.right, b.right) - Math.max(a.left, b.left);
                    const down = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
                    if (across > 0.5 && down > 0.5) bad.push(`${name} over ${other}`);
                }
            });
            if (document.documentElement.scrollWidth > innerWidth) bad.push("sideways scroll");
            return bad;
        }"""
    )
    return found


def test_the_head_overlaps_itself_at_no_width(page: BrowserPage, other: Page) -> None:
    """From 320 to 1,440 px; 200 % zoom of a laptop's 1,280 or 1,440 px are 640 and 720 of them."""
    ride(page)
    fall(page, other)
    for width, height in itertools.product(WIDTHS, (450, 900)):
        page.set_viewport_size({"width": width, "height": height})
        assert overlaps(page) == [], (width, height)
    page.set_viewport_size({"width": 1280, "height": 800})


@pytest.mark.parametrize("size", [(1440, 900), (1280, 720)])
def test_the_events_move_nothing_else(page: BrowserPage, size: tuple[int, int]) -> None:
    page.set_viewport_size({"width": size[0], "height": size[1]})
    ride(page)
    boxes = """['map', 'charts', 'behind', 'push-left'].map(
        (id) => JSON.stringify(document.getElementById(id).getBoundingClientRect()))"""
    before = page.evaluate(boxes)
    event = "{ n: 1e9 + n, t: n, level: 'info', text: `event ${n}` }"
    inside(page, f"{{ for (let n = 0; n < 150; n++) live.event({event}); }}")
    for tab in ("events", "training", "loop", "events"):
        page.locator(f"#tab-{tab}").click()
        drawn(page)
        after = page.evaluate(boxes)
        # Training has more to show: the charts give it room, the map does not.
        assert after[0] == before[0], tab
        assert after[3] == before[3], tab
        if tab != "training":
            assert after == before, tab
    assert page.locator("#event-list li").count() > 60
    assert page.evaluate("document.documentElement.scrollHeight") <= size[1]


def test_a_hand_over_is_told_who_rides_and_why(page: BrowserPage, other: Page) -> None:
    ride(page)
    saw(page, "^LQR, a linear controller, rides")
    ridden(page, 80)
    assert other.ask("push", lean_rate=0.55)["ok"]
    line = saw(page, "took over from LQR: ")
    why = r"it (was about to fall|leaned too fast) \(.+ is beyond .+\)\. .+ ago\.$"
    assert re.match(rf"LQR, body ±2 cm took over from LQR: {why}", line), line
    expect(page.locator("#controller")).to_have_value("lqr")
    page.locator("#tab-events").click()
    expect(page.locator("#event-list")).to_contain_text("LQR, body ±2 cm takes over: ")
    expect(page.locator("#event-list")).to_contain_text("LQR rides again: calm again")
    expect(page.locator("#who-text")).to_have_text(re.compile("^LQR, a linear controller, rides"))
    assert "hand_over" in inside(page, "live.marks.map(({ kind }) => kind)")
    expect(page.locator("#legend")).to_contain_text("LQR, body ±2 cm")
    page.locator("#tab-loop").click()


def test_the_mark_of_a_fall_stays_where_it_fell(page: BrowserPage, other: Page) -> None:
    ride(page)
    ridden(page, 80)
    x, y = fall(page, other)
    page.locator("#reset").click()
    expect(page.locator("#mode")).to_have_text("waits for a goal")
    for _ in range(2):
        falls = inside(page, "live.marks.filter(({ kind }) => kind === 'fell')")
        assert math.dist((falls[-1]["x"], falls[-1]["y"]), (x, y)) < 0.2
        assert math.hypot(x, y) > 1.0
        page.reload()
        whole(page)


def test_pausing_while_it_lies_is_shown_and_can_be_undone(page: BrowserPage, other: Page) -> None:
    ride(page)
    fall(page, other)
    pause = page.locator("#pause")
    pause.click()
    expect(pause).to_contain_text("Go on")
    pause.click()
    expect(pause).to_contain_text("Pause")
    pause.click()
    expect(pause).to_contain_text("Go on")
    page.locator("#reset").click()
    said(page, "waits at the origin for a goal: time is paused, press Go on$")
    page.mouse.click(*place(page, 0.7, 0.5))
    said(page, r"^goal \(.+\) sent: time is paused, press Go on$")
    expect(page.locator("#mode")).to_have_text("paused")
    pause.click()
    expect(page.locator("#mode")).to_have_text("riding")


def test_it_says_that_it_records_once_it_does_and_not_before(page: BrowserPage) -> None:
    record = page.locator("#record")
    record.click()
    expect(record).to_contain_text("Recorder starts")
    expect(record).to_contain_text("Stop recording")
    ride(page)
    ridden(page, 60)
    record.click()
    expect(record).to_contain_text(re.compile("Record$"))
    said(page, "^recorded bag-")
    open_newest(page)
    first = inside(page, "player.bag.series.row(0)")
    assert (first["step"], first["x"], first["y"]) == (0, 0, 0), "the ride's beginning is in it"
    page.locator("#live").click()


def open_newest(page: BrowserPage) -> None:
    page.locator("#bag").click()
    page.locator("#bag-list button").first.click()
    expect(page.locator("#mode")).to_have_text("bag")


def test_a_bag_shows_its_goals_its_own_time_and_what_the_button_does(page: BrowserPage) -> None:
    record = page.locator("#record")
    record.click()
    expect(record).to_contain_text("Stop recording")
    ride(page, 0.97, 0.5)  # far away: it is not reached
    ridden(page, 60)
    record.click()
    expect(record).to_contain_text(re.compile("Record$"))

    page.locator("#bag").click()
    newest = page.locator("#bag-list button").first
    expect(newest).to_contain_text(re.compile(r"ride of \d+:\d\d min"))
    newest.click()
    expect(page.locator("#mode")).to_have_text("bag")
    duration = inside(page, "player.bag.duration")
    page.locator("#seek").fill(str(duration))
    goal = inside(page, "player.bag.goal")
    assert goal is not None
    for size in ((390, 844), (1280, 800)):  # also once the telephone is turned
        page.set_viewport_size({"width": size[0], "height": size[1]})
        drawn(page)
        x, y = inside(page, f"view.toScreen({goal[0]}, {goal[1]})")
        width, height = inside(page, "[view.width, view.height]")
        assert 0 < x < width
        assert 0 < y < height
    page.locator("#tab-events").click()
    where = f"rides to goal ({goal[0]:.1f}, {goal[1]:.1f})"
    expect(page.locator("#event-list")).to_contain_text(where)

    page.locator("#seek").fill("0")
    page.locator("#rate").select_option("0.25")
    page.locator("#play").click()
    expect(page.locator("#play")).to_contain_text("Stop")
    page.locator("#play").click()
    expect(page.locator("#play")).to_contain_text("Play")
    page.locator("#live").click()
    expect(page.locator("#event-list")).to_contain_text(where)  # the live ride's own
    page.locator("#tab-loop").click()


def test_a_policy_has_one_colour_in_every_browser_and_no_other_has_it(
    page: BrowserPage, started: Started
) -> None:
    ride(page)
    names = ["naf", "lqr-20cm", "ppo", "lqr-displacement", "fixed-speed", "small-displacement"]
    names += ["learned-speed", "lqr-pedal", "lqr-displacement-pedal", "lqr"]
    for name in names:
        page.locator("#controller").select_option(name)
        expect(
            page.locator("#legend li").filter(has_text=re.compile(f"^{re.escape(label(name))}$"))
        ).to_have_count(1)
    legend = """() => {
        const pen = document.createElement("canvas").getContext("2d");
        const seen = (colour) => {
            pen.fillStyle = colour;
            pen.fillRect(0, 0, 1, 1);
            return `rgb(${pen.getImageData(0, 0, 1, 1).data.slice(0, 3)})`;
        };
        return Object.fromEntries([...document.querySelectorAll("#legend li")].map((item) =>
            [item.textContent, seen(getComputedStyle(item.querySelector("i")).color)]));
    }"""
    second = page.context.new_page()
    second.goto(started[0])
    whole(second)
    expect(second.locator("#legend li")).to_have_count(page.locator("#legend li").count())
    assert page.evaluate(legend) == second.evaluate(legend)
    second.close()
    page.bring_to_front()
    try:
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            waiting.until(partial(_legible, page, legend))
            mine = page.evaluate(legend)
            assert len(set(mine.values())) == len(mine) >= len(names)
            goal = page.evaluate("getComputedStyle(document.body).getPropertyValue('--good')")
            assert goal.strip() not in {_hex(colour) for colour in mine.values()}
    finally:
        page.emulate_media(color_scheme="light")


def _legible(page: BrowserPage, legend: str) -> bool:
    """Return True if every colour of a legend stands out from its card."""
    card = page.evaluate("getComputedStyle(document.body).getPropertyValue('--card')").strip()
    return all(contrast(_hex(colour), card) >= 3.0 for colour in page.evaluate(legend).values())


def _hex(colour: str) -> str:
    """Return `rgb(1, 2, 3)` as `#010203`."""
    red, green, blue = (int(word) for word in re.findall(r"\d+", colour)[:3])
    return f"#{red:02x}{green:02x}{blue:02x}"


def contrast(one: str, other: str) -> float:
    """Return the contrast of two colours like `#010203`, as WCAG 2 has it."""

    def luminance(colour: str) -> float:
        parts = [int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)]
        linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_colours_beyond_the_named_ones_are_never_the_same(page: BrowserPage) -> None:
    found = page.evaluate(
        """async () => {
            const { policyColour } = await import("/web/theme.js");
            return Array.from({ length: 60 }, (_, slot) => policyColour(slot));
        }"""
    )
    assert len(set(found)) == 60
    assert page.evaluate("(colours) => colours.every((one) => CSS.supports('color', one))", found)


def test_the_legend_has_a_ground_and_names_only_what_is_shown(page: BrowserPage) -> None:
    ride(page)
    expect(page.locator("#legend li")).not_to_have_count(0)
    ground = page.evaluate("getComputedStyle(document.getElementById('legend')).backgroundColor")
    parts = [float(word) for word in re.findall(r"[\d.]+", ground)]
    alpha = parts[3] if "/" in ground or ground.startswith("rgba") else 1.0
    assert alpha > 0.5, ground
    shown = page.evaluate(
        """async () => {
            const { Series } = await import("/web/series.js");
            const series = new Series(["t", "policy"]);
            series.push(Array.from({ length: 40000 }, (_, n) => [n, n < 5000 ? 7 : 2]), 0);
            return series.policiesIn(0, series.length - 1);
        }"""
    )
    assert shown == [2], "the first one rode so long ago that its track is gone"


def test_on_a_slow_line_it_says_that_it_loads(page: BrowserPage) -> None:
    """400 ms and 50 kB/s: for 15 s the badge said "riding" and everything else "–"."""
    ride(page)
    session = page.context.new_cdp_session(page)
    session.send("Network.enable")
    slow = {"offline": False, "latency": 400, "downloadThroughput": 50e3, "uploadThroughput": 50e3}
    session.send("Network.emulateNetworkConditions", slow)
    page.add_init_script(
        """document.addEventListener("DOMContentLoaded", () => {
            window.seen = new Set();
            const look = () => window.seen.add(["mode", "time"].map(
                (id) => document.getElementById(id).textContent).join("|"));
            new MutationObserver(look).observe(document.querySelector("header"),
                { subtree: true, childList: true, characterData: true });
        });"""
    )
    page.reload()
    expect(page.locator("#mode")).to_have_text("riding")
    whole(page)
    seen = page.evaluate("[...window.seen]")
    session.send(
        "Network.emulateNetworkConditions",
        {**slow, "latency": 0, "downloadThroughput": -1, "uploadThroughput": -1},
    )
    assert "riding|–" not in seen
    assert hole(steps_of(page)) is None


# Words.


def test_words_are_for_a_person_with_buttons(page: BrowserPage, other: Page) -> None:
    page.mouse.click(*place(page, 0.8, 0.5))
    said(page, r"^goal \(.+\) sent$")
    expect(page.locator("#mode")).to_have_text("riding")
    page.keyboard.down("Shift")
    page.mouse.click(*place(page, 0.8, 0.3))
    page.keyboard.up("Shift")
    said(page, "sent by way of 1 point$")
    page.locator("#step").click()
    said(page, "^no step: press Pause first")
    page.locator("#clear").click()
    said(page, "^goals cleared$")
    page.locator("#tab-events").click()
    expect(page.locator("#event-list")).to_contain_text("cancelled: all goals were cleared")
    ride(page)
    fall(page, other)
    page.locator("#push-left").click()
    said(page, "^not pushed: the bicycle lies, press Reset$")
    page.locator("#step").click()
    said(page, "^no step: the bicycle lies, press Reset$")
    everything = page.locator("body").inner_text()
    for word in ("bicycle/", "FRESH", "HELD", "empty path", "1 points"):
        assert word not in everything, word
    page.locator("#tab-loop").click()


def test_a_goal_is_told_once_however_many_waypoints_follow(page: BrowserPage) -> None:
    page.mouse.click(*place(page, 0.9, 0.5))
    goal = said(page, r"^goal (\(.+\)) sent$")[1]
    page.keyboard.down("Shift")
    for down in (0.2, 0.3, 0.4):
        page.mouse.click(*place(page, 0.8, down))
        said(page, "sent by way of")
        ridden(page, 16)
    page.keyboard.up("Shift")
    page.locator("#tab-events").click()
    expect(page.locator("#event-list li", has_text=f"rides to goal {goal}")).to_have_count(1)
    page.locator("#tab-loop").click()


def test_a_bicycle_that_waits_is_not_shown_as_riding_or_in_trouble(
    browser: BrowserContext,
) -> None:
    with cockpit() as (address, _, _), opened(browser, address, "waits for a goal") as page:
        expect(page.locator("#loop")).to_contain_text("– Hz")
        expect(page.locator("#loop [data-level=warn], #loop [data-level=bad]")).to_have_count(0)
        expect(page.locator("#speed-name")).to_have_text("starts at")
        expect(page.locator("#who-text")).to_have_text(
            "DDPG actor waits for a goal: click on the map."
        )


def preview_drawn(page: BrowserPage) -> bool:
    """Return True if the map's own pixels show the broad line along the steering."""
    drawn: bool = page.evaluate(
        """async () => {
            const { drawMap } = await import("/web/map.js");
            const { live, view } = await import("/web/main.js");
            await new Promise(requestAnimationFrame);
            const context = document.getElementById("map").getContext("2d");
            let broad = 0;
            const stroke = context.stroke;
            context.stroke = function () { broad += this.globalAlpha < 0.3; stroke.call(this); };
            dispatchEvent(new Event("resize"));
            for (let n = 0; n < 8; n++) await new Promise(requestAnimationFrame);
            context.stroke = stroke;
            return broad > 0;
        }"""
    )
    return drawn


def test_a_bicycle_that_lies_has_no_way_ahead(page: BrowserPage, other: Page) -> None:
    ride(page)
    assert preview_drawn(page)
    fall(page, other)
    assert not preview_drawn(page)
    expect(page.locator("#speed-name")).to_have_text("fell at")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_lean_at_which_it_falls_can_be_seen(page: BrowserPage, scheme: Any) -> None:
    page.emulate_media(color_scheme=scheme)
    try:
        # The page hears of the new colours some frames later.
        waiting.until(lambda: _contrast_of_the_fall(page) >= 3.0)
    finally:
        page.emulate_media(color_scheme="light")


def _contrast_of_the_fall(page: BrowserPage) -> float:
    """Return the best contrast between the card and what is drawn at 30 degrees of lean."""
    drawn(page)
    found = page.evaluate(
        """() => {
            const canvas = document.getElementById("behind");
            const [width, height] = [canvas.clientWidth, canvas.clientHeight];
            const ratio = canvas.width / width;
            const ground = height - (width < 240 ? 42 : 30);
            const scale = (ground - 22) / 1.85;
            const context = canvas.getContext("2d");
            const seen = [];
            for (let r = 0.8 * scale; r < 1.7 * scale; r += 0.5) {
                const x = (width / 2 - r * Math.sin(Math.PI / 6)) * ratio;
                const y = (ground - r * Math.cos(Math.PI / 6)) * ratio;
                seen.push([...context.getImageData(Math.round(x), Math.round(y), 1, 1).data]);
            }
            return seen;
        }"""
    )
    card = page.evaluate("getComputedStyle(document.body).getPropertyValue('--card')").strip()
    seen = [pixel for pixel in found if pixel[3] > 200]
    return max(
        (contrast("#{:02x}{:02x}{:02x}".format(*pixel[:3]), card) for pixel in seen), default=0.0
    )


def test_the_pedal_has_a_strip_where_there_is_one(
    browser: BrowserContext, page: BrowserPage
) -> None:
    strips = page.locator("#charts")
    expect(strips).to_have_attribute("aria-label", re.compile("displacement, speed$"))
    words = ("simulator.scenario:=learned-speed", "controller.policy:=learned-speed")
    with cockpit(*words) as (address, _, _), opened(browser, address) as pedalled:
        expect(pedalled.locator("#charts")).to_have_attribute(
            "aria-label", re.compile("pedal force, speed$")
        )


def test_a_controller_that_does_not_suit_the_ride_is_told(page: BrowserPage) -> None:
    page.locator("#controller").select_option("learned-speed")
    why = "it uses 100 N of pedal force and 0 N are allowed"
    said(page, f"^learned-speed is in charge, but it does not suit this ride: {why}")
    expect(page.locator("#who-text")).to_contain_text(
        f"DDPG actor with pedals does not suit this ride: {why}"
    )
    page.locator("#controller").select_option("lqr")
    said(page, "^lqr is in charge$")
    expect(page.locator("#who-text")).not_to_contain_text("does not suit")


# Keyboard and names (WCAG 2.1.4, 2.5.3).


def test_single_letters_can_be_switched_off_and_stay_off(page: BrowserPage) -> None:
    ride(page)
    page.locator("#help").click()
    page.locator("#letters").uncheck()
    page.keyboard.press("Escape")
    for _ in range(2):
        page.locator("body").press("c")
        page.locator("body").press("r")
        page.locator("body").press(".")
        page.locator("body").press("?")
        ridden(page, 20)
        expect(page.locator("#mode")).to_have_text("riding")
        expect(page.locator("#keys")).to_be_hidden()
        assert page.locator("kbd.letter:visible").count() == 0
        page.reload()
        expect(page.locator("#mode")).to_have_text("riding")
    page.locator("body").press(" ")
    expect(page.locator("#mode")).to_have_text("paused")
    page.locator("body").press(" ")
    page.locator("#help").click()
    page.locator("#letters").check()
    page.keyboard.press("Escape")
    page.locator("body").press("r")
    said(page, "waits at the origin")


def test_every_control_is_called_what_is_written_on_it(page: BrowserPage) -> None:
    named = page.evaluate(
        """() => [...document.querySelectorAll("[aria-label]")].map((element) => {
            const copy = element.cloneNode(true);
            copy.querySelectorAll("[aria-hidden=true], canvas").forEach((part) => part.remove());
            const tag = element.tagName.toLowerCase();
            return [tag, element.getAttribute("role"), element.ariaLabel, copy.textContent.trim()];
        })"""
    )
    bare = [one for one in named if one[0] in ("div", "span", "p") and not one[1]]
    assert bare == [], "a name on an element that has no role is read by nobody"
    # A sign such as + has no words that a name could repeat.
    for tag, _, name, text in named:
        if tag == "button" and re.search("[A-Za-z]{2}", text):
            assert text.lower() in name.lower()


# What dies.


def kill(name: str, domain: int) -> None:
    """End a process that the cockpit started."""
    folder = COCKPIT.parent / "runs" / "pids" / str(domain)
    (note,) = folder.glob(f"{name}.*")
    os.kill(int(note.suffix[1:]), signal.SIGKILL)


def test_a_dead_controller_is_told_where_everybody_looks(browser: BrowserContext) -> None:
    with cockpit() as (address, _, domain), opened(browser, address, "waits for a goal") as page:
        ride(page)
        saw(page, "rides")
        kill("controller", domain)
        saw(page, "^controller was killed by SIGKILL.*: the cockpit starts it")
        expect(page.locator("#who")).to_have_attribute("data-level", re.compile("warn|info|bad"))
        expect(page.locator("#who-text")).to_have_text(re.compile("rides|waits for a goal|fell"))


def test_a_dead_simulator_is_told_and_started_again(browser: BrowserContext) -> None:
    with cockpit() as (address, process, domain):
        with opened(browser, address, "waits for a goal") as page:
            ride(page)
            ridden(page, 40)
            told(page)
            kill("simulator", domain)
            saw(page, "^simulator was killed by SIGKILL.*: the cockpit starts it")
            expect(page.locator("#mode")).not_to_have_text("no simulator")
            until(page, "live.ride === 1 && live.series.first === 0")
            assert hole(steps_of(page)) is None, "the old ride is gone, the new one is whole"
            ride(page, 0.6, 0.4)
        assert process.running


def test_a_cockpit_that_is_gone_is_told_and_nothing_old_looks_new(browser: BrowserContext) -> None:
    with socket.create_server(("127.0.0.1", 0)) as line:
        port = str(line.getsockname()[1])
    with cockpit("--port", port) as (address, process, _):
        page = browser.new_page()
        page.goto(address)
        expect(page.locator("#mode")).to_have_text("waits for a goal")
        ride(page)
        brightness = "getComputedStyle(document.querySelector('main')).opacity"
        assert page.evaluate(brightness) == "1"
        assert process.stop(signal.SIGINT) == 0
        expect(page.locator("#mode")).to_have_text("connection lost")
        expect(page.locator("#who-text")).to_contain_text("What is shown is old")
        assert float(page.evaluate(brightness)) < 0.8
        for control in ("pause", "reset", "push-left", "record", "controller"):
            expect(page.locator(f"#{control}")).to_be_disabled()
        page.mouse.click(*place(page, 0.5, 0.5))
        said(page, "^not connected to the cockpit$")
    with cockpit("--port", port):
        expect(page.locator("#mode")).to_have_text("waits for a goal")
        said(page, "^connected again$")
        expect(page.locator("#pause")).to_be_enabled()
        assert page.evaluate(brightness) == "1"
        assert hole(steps_of(page)) is None
        page.close()
