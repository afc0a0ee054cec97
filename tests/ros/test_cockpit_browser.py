"""The cockpit in a real browser: Debian's Chromium, a real ride, and pictures of it.

The pictures are kept in the folder of BICYCLE_SCREENSHOTS, or in runs/screenshots.
"""

from __future__ import annotations

import math
import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
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
    said,
    shoot,
    until,
)
from node_process import NodeProcess
from policies import own_policy
from probe import Probe
from waiting import until as waited

from bicycle_common.nodes import topics
from bicycle_controller.policy.policy import save_policy

RIDE = Path(__file__).resolve().parents[1] / "data" / "film-ride"


SIZES = [(1440, 900), (1280, 800), (820, 1180), (844, 390), (390, 844)]
COVERED = """() => {
    const parts = [...document.querySelectorAll(".controls :is(button, select, input, output)")];
    const boxes = parts.map((part) => part.getBoundingClientRect());
    const over = (a, b) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1 &&
        Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 1;
    return boxes.flatMap((a, n) => boxes.slice(n + 1).flatMap((b, m) =>
        over(a, b) ? [`${parts[n].id} and ${parts[n + 1 + m].id}`] : []));
}"""

pytestmark = [pytest.mark.ros, pytest.mark.slow]


@pytest.fixture(scope="module")
def browser() -> Iterator[BrowserContext]:
    """Yield a Chromium."""
    with chromium() as context:
        yield context


@pytest.fixture(scope="module")
def started(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Started]:
    """Yield a cockpit with its own ride."""
    folder, models = (tmp_path_factory.mktemp(name) for name in ("bags", "models"))
    shutil.copytree(RIDE, folder / RIDE.name)
    for name in ("best", "policies/00000500"):
        save_policy(own_policy(wear=0.01 * len(name)), models / "mine" / f"{name}.safetensors")
    words = "--bags", str(folder), "--models", str(models), "controller.policy:=lqr"
    with cockpit(*words) as result:
        yield result


@pytest.fixture(scope="module")
def page(browser: BrowserContext, started: Started) -> Iterator[BrowserPage]:
    """Yield the page, connected."""
    with opened(browser, started[0], "waits for a goal") as result:
        yield result


def test_a_click_sends_the_bicycle_to_where_it_was_made(
    page: BrowserPage, started: Started
) -> None:
    page.locator("#record").click()
    said(page, "^the recorder of bag-.* starts$")
    expect(page.locator("#record")).to_have_text(re.compile("Stop recording"))
    page.mouse.click(*place(page, 0.62, 0.4))
    goal = [float(word) for word in said(page, r"goal \((.+), (.+)\) sent").groups()]
    # The bicycle began in the middle of the map, at the origin.
    assert goal[0] > 5.0
    assert goal[1] > 3.0
    expect(page.locator("#mode")).to_have_text("riding")
    shoot(page, "riding")
    page.locator("#tab-events").click()
    reached = f"goal ({goal[0]:.1f}, {goal[1]:.1f}) reached after"
    expect(page.locator("#event-list")).to_contain_text(reached)
    own = Page(started[0])
    # The goal's radius is 1 m, and the place is shown to 0.1 m. Rows come in parts, newest first.
    own.until(lambda: any(math.dist((row["x"], row["y"]), goal) < 1.2 for row in own.rows))
    own.close()
    page.locator("#tab-loop").click()
    expect(page.locator("#who-text")).to_have_text(re.compile("^LQR, a linear controller, rides"))
    page.locator("#record").click()
    expect(page.locator("#record")).to_have_text(re.compile("Record$"))


def test_a_drag_gives_a_heading_and_shift_adds_waypoints(page: BrowserPage) -> None:
    page.keyboard.press("r")
    said(page, "^the bicycle waits at the origin for a goal$")
    page.mouse.move(*place(page, 0.7, 0.5))
    page.mouse.down()
    page.mouse.move(*place(page, 0.8, 0.5), steps=4)
    page.mouse.up()
    asked = said(page, r"goal \(.+\) sent to arrive at (-?\d+)°$")
    until(page, "live.status.goal?.length === 3")
    heading = math.degrees(inside(page, "live.status.goal[2]"))
    assert heading == pytest.approx(float(asked[1]), abs=0.51)
    page.keyboard.press("c")
    said(page, "goals cleared")
    page.mouse.click(*place(page, 0.75, 0.5))
    said(page, r"goal \(.+\) sent$")
    until(page, "live.status.goal?.length === 2")
    page.keyboard.down("Shift")
    page.mouse.click(*place(page, 0.8, 0.3))
    page.keyboard.up("Shift")
    said(page, "sent by way of 1 point$")


def moment(page: BrowserPage, after: float = 0.0) -> str:
    """Return the time that the page shows, after some milliseconds."""
    page.wait_for_timeout(after)
    return page.locator("#time").inner_text()


def test_push_pause_and_switch(page: BrowserPage) -> None:
    page.locator("#push-left").click()
    said(page, "^pushed to the left$")
    page.locator("#pause").click()
    expect(page.locator("#mode")).to_have_text("paused")
    # States from before the pause may come after the word, but not for ever.
    assert waited(lambda: moment(page) == moment(page, after=400))
    page.locator("#step").click()
    said(page, "^one step made$")
    page.locator("#pause").click()
    expect(page.locator("#mode")).to_have_text("riding")
    labels = {"fixed-speed": "DDPG actor", "naf": "NAF actor", "ppo": "PPO actor"}
    for name, label in labels.items():
        page.locator("#controller").select_option(name)
        expect(page.locator("#who-text")).to_have_text(
            re.compile(f"^{label}, a neural network, rides")
        )
        expect(page.locator("#legend li", has_text=label)).to_have_count(1)
        assert re.match(
            rf"policy {name}@[0-9a-f]+$", page.locator("#who").get_attribute("title") or ""
        )


def test_in_3d_a_click_sends_it_and_a_drag_of_the_rider_pushes(page: BrowserPage) -> None:
    page.keyboard.press("r")
    said(page, "^the bicycle waits at the origin for a goal$")
    page.keyboard.press("m")
    expect(page.locator("#ride")).to_have_attribute("data-main", "3d")
    until(page, "views.stage.bicycle !== null")
    box = page.locator("#stage").bounding_box()
    assert box is not None
    # The chase camera looks along the bicycle: beside the rider lies what is ahead on the left.
    page.mouse.click(box["x"] + 0.25 * box["width"], box["y"] + 0.45 * box["height"])
    goal = [float(word) for word in said(page, r"goal \((.+), (.+)\) sent").groups()]
    assert goal[0] > 2.0
    expect(page.locator("#mode")).to_have_text("riding")
    rider = inside(page, "views.stage.whereRider()")
    page.mouse.move(box["x"] + rider[0], box["y"] + rider[1])
    page.mouse.down()
    page.mouse.move(box["x"] + rider[0] + 60, box["y"] + rider[1], steps=3)
    expect(page.locator("#pull")).to_be_visible()
    said(page, r"^Let go: a push of 0\.\d+ rad/s to the right$")
    page.mouse.up()
    said(page, "^pushed to the right$")
    shoot(page, "3d")
    page.locator("#swap").click()
    expect(page.locator("#ride")).to_have_attribute("data-main", "map")


def test_another_ride_is_set_up_in_the_page(page: BrowserPage) -> None:
    page.locator("#controller").select_option("lqr")
    until(page, "live.status.who.chosen.name === 'lqr'")
    page.locator("#set-up").click()
    expect(page.locator("#setup-bicycle")).to_be_disabled()
    expect(page.locator("#setup-controller")).to_have_value("lqr")
    page.locator("#setup-plant").select_option("whipple")
    expect(page.locator("#setup-bicycle")).to_be_enabled()
    expect(page.locator("#setup-controller")).to_have_value("any-bicycle")
    page.locator("#setup-sensors").select_option("mpu6050-rtk")
    expect(page.locator("#setup-controller")).to_have_value("lqr")
    shoot(page, "setup")
    chosen = page.locator("#setup-sensors option:checked")
    expect(chosen).to_have_text("The same and an RTK receiver")
    expect(chosen).to_have_attribute("title", "mpu6050-rtk")
    cut = """() => [...document.querySelectorAll("#setup-form option")].filter((one) => {
        const context = document.createElement("canvas").getContext("2d");
        context.font = getComputedStyle(one.closest("select")).font;
        const { clientWidth } = one.closest("select");
        return context.measureText(one.text).width > clientWidth - 34;
    }).map((one) => one.text)"""
    assert page.evaluate(cut) == []
    page.locator("#setup-plant").select_option("choi")
    page.locator("#setup-sensors").select_option("")
    page.locator("#setup-controller").select_option("lqr")
    page.locator("#setup-speed").fill("6")
    page.locator("#setup-form button").click()
    said(page, "the bicycle waits at the origin for a goal")
    until(page, "live.series.speed.at(-1) === 6")

    def refused() -> bool:
        """Return True once it is; a controller that has just begun may not know the speed yet."""
        page.locator("#course").select_option("square")
        page.wait_for_timeout(1000.0)
        return "path square refused: " in page.locator("#answer").inner_text()

    waited(refused)
    page.locator("#course").select_option("straight")
    said(page, "the course straight is sent")
    until(page, "live.path.length > 1")
    page.locator("#clear").click()
    said(page, "goals cleared")


def test_the_keyboard_alone_sends_a_goal(page: BrowserPage) -> None:
    page.locator("#map").focus()
    for _ in range(2):
        page.keyboard.press("Shift+ArrowRight")
    page.keyboard.press("ArrowUp")
    expect(page.locator("#mark")).to_have_text(re.compile(r"^mark at "))
    page.keyboard.press("Enter")
    said(page, r"goal \(.+\) sent$")
    page.keyboard.press("?")
    expect(page.locator("#keys")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.locator("#keys")).to_be_hidden()


def test_a_bag_is_scrubbed_on_the_same_page(page: BrowserPage) -> None:
    page.evaluate("document.getElementById('guide').hidden = false")
    expect(page.locator("#guide")).to_be_visible()
    page.locator("#bag").click()
    page.locator("#bag-list button").first.click()
    expect(page.locator("#mode")).to_have_text("bag")
    expect(page.locator("#guide")).to_be_hidden()  # nothing of it can be tried in a bag
    expect(page.locator("#push-left")).to_be_disabled()
    duration = float(page.locator("#seek").get_attribute("max") or "nan")
    assert duration > 2.0
    places = []
    for share in (0.0, 0.5, 1.0):
        page.locator("#seek").fill(str(share * duration))
        drawn(page)
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
    expect(page.locator("#play")).to_contain_text("Play")
    assert position(page) == places[2]
    page.locator("#live").click()
    expect(page.locator("#timeline")).to_be_hidden()
    expect(page.locator("#mode")).not_to_have_text("bag")
    expect(page.locator("#guide")).to_be_visible()
    page.locator("#guide-close").click()


@pytest.mark.parametrize("label", ["mine", "mine after 500 updates"])
def test_a_policy_of_ones_own_is_the_ghost_of_a_bag(page: BrowserPage, label: str) -> None:
    page.locator("#bag").click()
    page.locator("#bag-list button", has_text=RIDE.name).click()
    expect(page.locator("#mode")).to_have_text("bag")
    page.locator("#compare").click()
    page.locator("#again-by").get_by_role("button", name=label, exact=True).click()
    expect(page.locator("#bags")).to_be_hidden()
    inside(page, "player.seek(3)")
    expect(page.locator("#gap")).to_contain_text(label)
    page.locator("#compare").click()
    page.locator("#live").click()


def test_the_trainer_is_shown(page: BrowserPage, started: Started) -> None:
    page.locator("#tab-training").click()
    expect(page.locator("#no-trainer")).to_be_visible()
    probe = Probe(started[2])
    kind = topics.TRAINER.type
    for step in range(8):
        share = 0.125 * step
        probe.say(
            topics.TRAINER,
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
    expect(page.locator("#trainer-facts")).to_contain_text("87.5 %")
    expect(page.locator("#trainer-facts")).to_contain_text("3500")
    shoot(page, "training")
    page.locator("#tab-loop").click()
    probe.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", SIZES)
def test_it_fits_the_screen(page: BrowserPage, size: tuple[int, int], scheme: Any) -> None:
    page.emulate_media(color_scheme=scheme)
    page.set_viewport_size({"width": size[0], "height": size[1]})
    drawn(page)
    wide = "() => document.documentElement.scrollWidth"
    assert page.evaluate(wide) <= size[0]
    nameless = page.evaluate(
        "() => [...document.querySelectorAll('button, select, input, canvas')].filter((e) => "
        "!(e.ariaLabel || e.labels?.length || e.textContent.trim())).map((e) => e.id)"
    )
    assert nameless == []
    assert page.evaluate(COVERED) == [], "controls lie over each other"
    shoot(page, f"{size[0]}-{scheme}", full_page=True)


def test_a_page_of_a_foreign_origin_gets_nothing(
    browser: BrowserContext, started: Started, tmp_path: Path
) -> None:
    (tmp_path / "index.html").write_text("<!doctype html><title>foreign</title>")
    server = [sys.executable, "-m", "http.server", "0", "--bind", "127.0.0.1"]
    with NodeProcess(server, cwd=tmp_path) as foreign:
        port = foreign.wait_for_line(r"port (\d+)")[1]
        result = browser.new_page()
        result.goto(f"http://127.0.0.1:{port}/")
        tried = result.evaluate(
            """async (address) => {
                const opened = await new Promise((resolve) => {
                    const socket = new WebSocket(address.replace("http", "ws") + "ws");
                    socket.onopen = () => resolve(true);
                    socket.onerror = () => resolve(false);
                });
                const read = await fetch(address + "bags").then(() => true, () => false);
                await new Promise((resolve) => {
                    const image = new Image();
                    image.onload = image.onerror = resolve;
                    image.src = address + "bags/any";
                });
                return { opened, read };
            }""",
            started[0],
        )
        result.close()
    assert tried == {"opened": False, "read": False}
    started[1].wait_for_line("'/bags/any' refused: a page of another site asks")
    own = Page(started[0])
    assert own.newest("status")["pages"] >= 1
    own.close()
