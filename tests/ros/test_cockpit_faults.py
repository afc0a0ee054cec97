"""Faults that people met on the page, each by its name, in a real browser over a real ride."""

from __future__ import annotations

import math
import os
import re
import signal
import socket

import pytest
from chromium import (
    BrowserContext,
    BrowserPage,
    Page,
    cockpit,
    drawn,
    expect,
    inside,
    kept_lines,
    opened,
    place,
    ridden,
    said,
    saw,
    until,
)
from cockpit_page import COCKPIT
from ridden_page import fall, hole, ride, steps_of, whole

pytest_plugins = ["ridden_page"]
pytestmark = [pytest.mark.ros, pytest.mark.slow]


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
    page.mouse.click(*place(page, 0.8, 0.3))
    said(page, "sent: the bicycle lies, press Reset$")
    page.locator("#reset").click()
    said(page, "^the bicycle starts at the origin to the goal sent while it lay$")
    expect(page.locator("#mode")).to_have_text("riding")
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


def test_a_controller_that_does_not_suit_the_ride_is_told(page: BrowserPage) -> None:
    page.locator("#controller").select_option("learned-speed")
    why = "it uses 100 N of pedal force and 0 N are allowed"
    said(page, f"^DDPG actor with pedals is in charge, but it does not suit this ride: {why}")
    expect(page.locator("#who-text")).to_contain_text(
        f"DDPG actor with pedals does not suit this ride: {why}"
    )
    page.locator("#controller").select_option("lqr")
    said(page, "^LQR is in charge$")
    expect(page.locator("#who-text")).not_to_contain_text("does not suit")


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
            kept_lines(page)
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
