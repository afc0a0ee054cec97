"""The cockpit in a real browser: Debian's Chromium, a real ride, and pictures of it.

The pictures are kept in the folder of BICYCLE_SCREENSHOTS, or in runs/screenshots.
"""

from __future__ import annotations

import math
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from cockpit_page import COCKPIT, Page, address_of
from domains import claimed_domain
from node_process import NodeProcess
from probe import Probe

from bicycle_sim.nodes import interfaces

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-sync",
    "--disable-background-networking",
    "--disable-component-update",
]
SHOTS = Path(os.environ.get("BICYCLE_SCREENSHOTS", COCKPIT.parent / "runs" / "screenshots"))
PATIENCE = 60_000
"""ms."""

if not CHROMIUM and not os.environ.get("CI"):
    pytest.skip(
        "no Chromium here for the browser tests: sudo apt-get install -y chromium",
        allow_module_level=True,
    )

from playwright.sync_api import BrowserContext, expect, sync_playwright  # noqa: E402
from playwright.sync_api import Page as BrowserPage  # noqa: E402

pytestmark = [pytest.mark.ros, pytest.mark.slow]


@pytest.fixture(scope="module")
def browser() -> Iterator[BrowserContext]:
    """A Chromium with a profile of its own."""
    assert CHROMIUM, "CI must have Chromium: .ci/run installs it"
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as profile:
        context = playwright.chromium.launch_persistent_context(
            profile,
            executable_path=CHROMIUM,
            args=FLAGS,
            viewport={"width": 1280, "height": 800},
        )
        context.set_default_timeout(PATIENCE)
        yield context
        context.close()


@pytest.fixture(scope="module")
def cockpit(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Path, int]]:
    """Address, folder of the bags and domain of a cockpit with its own ride."""
    folder = tmp_path_factory.mktemp("bags")
    words = [str(COCKPIT), "--port", "0", "--bags", str(folder), "controller.policy:=lqr"]
    with claimed_domain() as domain, NodeProcess(words, {"ROS_DOMAIN_ID": str(domain)}) as process:
        yield address_of(process), folder, domain


@pytest.fixture(scope="module")
def page(browser: BrowserContext, cockpit: tuple[str, Path, int]) -> Iterator[BrowserPage]:
    """The page, connected; nothing that it logs as an error is forgiven."""
    made = browser.new_page()
    errors: list[str] = []
    made.on("pageerror", lambda error: errors.append(str(error)))
    made.on("console", lambda line: errors.append(line.text) if line.type == "error" else None)
    made.goto(cockpit[0])
    expect(made.locator("#mode")).to_have_text("waits for a goal", timeout=PATIENCE)
    yield made
    assert errors == []
    made.close()


def shoot(page: BrowserPage, name: str, **more: Any) -> None:
    """Keep a picture of the page."""
    SHOTS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=str(SHOTS / f"{name}.png"), **more)


def position(page: BrowserPage) -> tuple[float, float]:
    x, y = page.locator("#position").inner_text().split(",")
    return float(x), float(y)


def place(page: BrowserPage, across: float, down: float) -> tuple[float, float]:
    """A point of the map, given as shares of its width and height."""
    box = page.locator("#map").bounding_box()
    assert box is not None
    return box["x"] + across * box["width"], box["y"] + down * box["height"]


def answer(page: BrowserPage, pattern: str) -> re.Match[str]:
    """What the line below the controls says, once it matches."""
    expect(page.locator("#answer")).to_have_text(re.compile(pattern), timeout=PATIENCE)
    found = re.search(pattern, page.locator("#answer").inner_text())
    assert found is not None
    return found


def test_a_click_sends_the_bicycle_to_where_it_was_made(
    page: BrowserPage, cockpit: tuple[str, Path, int]
) -> None:
    page.locator("#record").click()
    answer(page, "^recording bag-")
    expect(page.locator("#record")).to_have_text(re.compile("Stop recording"), timeout=PATIENCE)
    page.wait_for_timeout(1500)  # the recorder looks for topics ten times a second
    page.mouse.click(*place(page, 0.62, 0.4))
    goal = [float(word) for word in answer(page, r"goal \((.+), (.+)\) sent").groups()]
    # The bicycle began in the middle of the map, at the origin.
    assert goal[0] > 5.0
    assert goal[1] > 3.0
    expect(page.locator("#mode")).to_have_text("riding", timeout=PATIENCE)
    shoot(page, "riding")
    page.locator("#tab-events").click()
    reached = f"goal ({goal[0]:.1f}, {goal[1]:.1f}) reached"
    expect(page.locator("#event-list")).to_contain_text(reached, timeout=PATIENCE)
    own = Page(cockpit[0])
    nearest = min(math.dist((row["x"], row["y"]), goal) for row in own.rows)
    own.close()
    assert nearest < 1.2, "the goal's radius is 1 m, and the place is shown to 0.1 m"
    page.locator("#tab-loop").click()
    expect(page.locator("#policy")).to_have_text(re.compile("^lqr"))
    page.locator("#record").click()
    expect(page.locator("#record")).to_have_text(re.compile("Record$"), timeout=PATIENCE)


def test_a_drag_gives_a_heading_and_shift_adds_waypoints(page: BrowserPage) -> None:
    page.keyboard.press("r")
    answer(page, "waits for its first command")
    page.mouse.move(*place(page, 0.7, 0.5))
    page.mouse.down()
    page.mouse.move(*place(page, 0.8, 0.5), steps=4)
    page.mouse.up()
    answer(page, r"goal \(.+\) sent by way of [12] points")
    page.keyboard.press("c")
    answer(page, "goals cleared")
    page.mouse.click(*place(page, 0.75, 0.5))
    answer(page, r"goal \(.+\) sent$")
    page.wait_for_timeout(500)
    page.keyboard.down("Shift")
    page.mouse.click(*place(page, 0.8, 0.3))
    page.keyboard.up("Shift")
    answer(page, "sent by way of 1 points")


def test_push_pause_and_switch(page: BrowserPage) -> None:
    page.locator("#push-left").click()
    answer(page, r"^pushed to the left at step \d+$")
    page.locator("#pause").click()
    expect(page.locator("#mode")).to_have_text("paused", timeout=PATIENCE)
    at = page.locator("#time").inner_text()
    page.wait_for_timeout(400)
    assert page.locator("#time").inner_text() == at
    page.locator("#step").click()
    answer(page, r"^step \d+: ")
    page.locator("#pause").click()
    expect(page.locator("#mode")).to_have_text("riding", timeout=PATIENCE)
    for count, name in enumerate(("fixed-speed", "naf", "ppo"), 2):
        page.locator("#controller").select_option(name)
        expect(page.locator("#policy")).to_have_text(re.compile(f"^{name}@"), timeout=PATIENCE)
        expect(page.locator("#legend li")).to_have_count(count)


def test_the_keyboard_alone_sends_a_goal(page: BrowserPage) -> None:
    page.locator("#map").focus()
    for _ in range(2):
        page.keyboard.press("Shift+ArrowRight")
    page.keyboard.press("ArrowUp")
    expect(page.locator("#mark")).to_have_text(re.compile(r"^mark at "))
    page.keyboard.press("Enter")
    answer(page, r"goal \(.+\) sent$")
    page.keyboard.press("?")
    expect(page.locator("#keys")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.locator("#keys")).to_be_hidden()


def test_a_bag_is_scrubbed_on_the_same_page(page: BrowserPage) -> None:
    page.locator("#bag").click()
    page.locator("#bag-list button").first.click()
    expect(page.locator("#mode")).to_have_text("bag", timeout=PATIENCE)
    expect(page.locator("#push-left")).to_be_disabled()
    duration = float(page.locator("#seek").get_attribute("max") or "nan")
    assert duration > 2.0
    places = []
    for share in (0.0, 0.5, 1.0):
        page.locator("#seek").fill(str(share * duration))
        page.wait_for_timeout(200)
        assert float(page.locator("#time").inner_text()) == pytest.approx(
            share * duration, abs=0.15
        )
        places.append(position(page))
    assert math.dist(places[0], places[1]) > 1.0
    assert math.dist(places[1], places[2]) > 1.0
    shoot(page, "bag")
    page.locator("#seek").fill("0")
    page.locator("#rate").select_option("8")
    page.locator("#play").click()
    expect(page.locator("#play")).to_have_attribute("aria-pressed", "false", timeout=PATIENCE)
    assert position(page) == places[2]
    page.locator("#live").click()
    expect(page.locator("#timeline")).to_be_hidden()
    expect(page.locator("#mode")).not_to_have_text("bag")


def test_the_trainer_is_shown(page: BrowserPage, cockpit: tuple[str, Path, int]) -> None:
    page.locator("#tab-training").click()
    expect(page.locator("#no-trainer")).to_be_visible()
    probe = Probe(cockpit[2])
    kind = interfaces.TRAINER.type
    for step in range(8):
        share = 0.125 * step
        probe.say(
            interfaces.TRAINER,
            kind(
                phase="learning",
                mode="live",
                updates=500 * step,
                reach_rate=share,
                fall_rate=1.0 - share,
                mean_return=-60.0 + 50.0 * share,
            ),
        )
        probe.spin_for(0.1)
    expect(page.locator("#trainer-facts")).to_contain_text("87.5 %", timeout=PATIENCE)
    expect(page.locator("#trainer-facts")).to_contain_text("3500")
    shoot(page, "training")
    page.locator("#tab-loop").click()
    probe.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [(1280, 800), (390, 844)])
def test_it_fits_the_screen(page: BrowserPage, size: tuple[int, int], scheme: Any) -> None:
    page.emulate_media(color_scheme=scheme)
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.wait_for_timeout(300)
    wide = "() => document.documentElement.scrollWidth"
    assert page.evaluate(wide) <= size[0]
    nameless = page.evaluate(
        "() => [...document.querySelectorAll('button, select, input, canvas')].filter((e) => "
        "!(e.ariaLabel || e.labels?.length || e.textContent.trim())).map((e) => e.id)"
    )
    assert nameless == []
    shoot(page, f"{size[0]}-{scheme}", full_page=True)


def test_a_page_of_a_foreign_origin_gets_nothing(
    browser: BrowserContext, cockpit: tuple[str, Path, int], tmp_path: Path
) -> None:
    (tmp_path / "index.html").write_text("<!doctype html><title>foreign</title>")
    server = [sys.executable, "-m", "http.server", "0", "--bind", "127.0.0.1"]
    with NodeProcess(server, cwd=tmp_path) as foreign:
        port = foreign.wait_for_line(r"port (\d+)")[1]
        made = browser.new_page()
        made.goto(f"http://127.0.0.1:{port}/")
        tried = made.evaluate(
            """async (address) => {
                const opened = await new Promise((resolve) => {
                    const socket = new WebSocket(address.replace("http", "ws") + "ws");
                    socket.onopen = () => resolve(true);
                    socket.onerror = () => resolve(false);
                });
                const read = await fetch(address + "bags").then(() => true, () => false);
                return { opened, read };
            }""",
            cockpit[0],
        )
        made.close()
    assert tried == {"opened": False, "read": False}
    own = Page(cockpit[0])
    assert own.newest("status")["pages"] >= 1
    own.close()
