"""The 3D picture, in a browser that draws it in software, over a recorded ride and without ROS."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from chromium import (
    BrowserContext,
    BrowserPage,
    chromium,
    drawn,
    expect,
    inside,
    opened,
    shoot,
    until,
)
from made_bag import write_bag
from playwright.sync_api import FloatRect
from served_page import served_page

from bicycle_sim.plants import registry

pytestmark = pytest.mark.slow

RIDE = Path(__file__).resolve().parents[1] / "data" / "film-ride"


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Yield a page that needs no cockpit."""
    folder = tmp_path_factory.mktemp("page")
    with served_page([write_bag(folder / "bag")], folder / "web") as result:
        yield result


@pytest.fixture(scope="module")
def browser() -> Iterator[BrowserContext]:
    """Yield a Chromium on its first visit."""
    with chromium(main="") as context:
        yield context


@pytest.fixture(scope="module")
def page(browser: BrowserContext, address: str) -> Iterator[BrowserPage]:
    """Yield the page with its first ride."""
    with opened(browser, address, "bag") as result:
        until(result, "player.bag !== null && views.stage !== null")
        yield result


def shown(page: BrowserPage) -> list[int]:
    """Sums of red, green and blue over the left and the right half of a new 3D picture."""
    sums: list[int] = inside(
        page,
        """(() => {
            views.stage.renderer.render(views.stage.world.scene, views.stage.eye.camera);
            const small = new OffscreenCanvas(2, 1).getContext("2d");
            small.drawImage(views.stage.canvas, 0, 0, 2, 1);
            return [...small.getImageData(0, 0, 2, 1).data];
        })()""",
    )
    return sums


def wheels(page: BrowserPage, geometry: dict[str, float], row: dict[str, float]) -> Any:
    """Return the axles and the turns of wheels and crank of a bicycle that is placed somewhere."""
    return page.evaluate(
        """async ([geometry, row]) => {
            const { Bicycle } = await import("/web/scene/bicycle.js");
            const made = new Bicycle(geometry);
            const at = (part) => part.getWorldPosition(part.position.clone()).toArray();
            made.pose({ x: 0, y: 0, heading: 0, lean: 0, steer: 0, displacement: 0 });
            made.pose({ x: 0, y: 0, heading: 0, lean: 0, steer: 0, displacement: 0, ...row });
            const [turn, crank] = [made.rear.rotation.y, made.crank.rotation.y];
            const [rear, front, head] = [made.rear, made.front, made.body.head].map(at);
            const found = { rear, front, head, turn, crank };
            made.dispose();
            return found;
        }""",
        [geometry, row],
    )


def test_the_bicycle_in_3d_is_the_main_picture_and_the_map_an_inset(page: BrowserPage) -> None:
    expect(page.locator("#ride")).to_have_attribute("data-main", "3d")
    stage, inset = (page.locator(name).bounding_box() for name in ("#stage", "#map"))
    assert stage is not None
    assert inset is not None
    assert inset["width"] * inset["height"] < 0.2 * stage["width"] * stage["height"]
    until(page, "views.stage.renderer.info.render.triangles > 5000")
    assert len(set(shown(page))) > 2


def test_every_camera_shows_something_else(page: BrowserPage) -> None:
    places = set()
    for camera in ("chase", "orbit", "side", "rider", "top"):
        page.locator(f"[data-camera={camera}]").click()
        expect(page.locator(f"[data-camera={camera}]")).to_have_attribute("aria-pressed", "true")
        until(page, f"views.stage.eye.mode === '{camera}' && !views.stage.eye.fresh")
        places.add(tuple(inside(page, "views.stage.eye.place.toArray()")))
    assert len(places) == 5
    page.locator("[data-camera=chase]").click()


@pytest.mark.parametrize("bicycle", ["", "benchmark", "browser-rider"])
def test_it_is_built_from_the_parameters_of_the_bicycle(page: BrowserPage, bicycle: str) -> None:
    plant = registry.named("whipple", bicycle) if bicycle else registry.default()
    size = plant.geometry
    found = wheels(page, asdict(size), {})
    assert found["rear"] == pytest.approx([0.0, 0.0, size.rear_radius])
    assert found["front"] == pytest.approx([size.wheelbase, 0.0, size.front_radius])
    steer = 0.4
    turned = wheels(page, asdict(size), {"steer": steer})
    # The front axle goes round the steering axis: its distance from the rear one along it stays.
    tilt = size.steer_axis_tilt
    axis = (-math.sin(tilt), 0.0, math.cos(tilt))
    along = [
        sum(a * b for a, b in zip(axis, one["front"], strict=True)) for one in (found, turned)
    ]
    assert along[0] == pytest.approx(along[1])
    offset = size.front_radius * math.sin(tilt) - size.trail * math.cos(tilt)
    assert turned["front"][1] == pytest.approx(offset * math.sin(steer), abs=1e-6)


def test_it_leans_and_heads_as_the_messages_say(page: BrowserPage) -> None:
    size = asdict(registry.default().geometry)
    right = wheels(page, size, {"lean": 0.2})
    assert right["head"][1] < -0.2, "lean is positive to the right, and y is to the left"
    shifted = wheels(page, size, {"displacement": 0.2})
    assert shifted["head"][1] > 0.1, "displacement is positive to the left"
    north = wheels(page, size, {"heading": math.pi / 2})
    assert north["front"][:2] == pytest.approx([0.0, size["wheelbase"]], abs=1e-9)


def test_wheels_and_legs_turn_by_the_way_that_is_ridden(page: BrowserPage) -> None:
    size = asdict(registry.default().geometry)
    found = wheels(page, size, {"x": 1.0})
    assert found["turn"] == pytest.approx(1.0 / size["rear_radius"])
    assert found["crank"] == pytest.approx(found["turn"] * size["crank_ratio"])


def test_parts_that_stay_together_are_one_mesh_and_keep_their_place(page: BrowserPage) -> None:
    size = asdict(registry.named("whipple", "browser-rider").geometry)
    found = page.evaluate(
        """async (geometry) => {
            const { Box3 } = await import("/web/vendor/three.module.min.js");
            const { Bicycle } = await import("/web/scene/bicycle.js");
            const made = new Bicycle(geometry);
            made.pose({ x: 0, y: 0, heading: 0, lean: 0, steer: 0, displacement: 0 });
            const box = new Box3().setFromObject(made.group, true);
            const meshes = [];
            made.group.traverse((part) => part.isMesh && meshes.push(part.geometry));
            const normals = meshes.map(({ attributes }) => {
                const { array } = attributes.normal;
                const lengths = [];
                for (let n = 0; n < array.length; n += 3) {
                    lengths.push(Math.hypot(array[n], array[n + 1], array[n + 2]));
                }
                return [Math.min(...lengths), Math.max(...lengths)];
            });
            made.dispose();
            const [low, high] = [box.min.toArray(), box.max.toArray()];
            return { low, high, meshes: meshes.length, normals };
        }""",
        size,
    )
    rear, front = size["rear_radius"], size["front_radius"]
    assert [found["low"][0], found["low"][2]] == pytest.approx([-rear, 0.0], abs=1e-3)
    assert found["high"][0] == pytest.approx(size["wheelbase"] + front, abs=1e-3)
    assert -found["low"][1] == pytest.approx(found["high"][1], abs=0.02), "it is straight"
    assert 1.6 < found["high"][2] < 2.0, "the helmet"
    assert found["meshes"] <= 45, "each is a call in every picture, and one more for its shadow"
    assert all(0.99 < low <= high < 1.01 for low, high in found["normals"])


def test_between_two_rows_it_is_in_between(page: BrowserPage) -> None:
    found = page.evaluate(
        """async () => {
            const { rowAt } = await import("/web/motion.js");
            const { player } = await import("/web/main.js");
            const { series } = player.bag;
            const middle = (series.t[10] + series.t[11]) / 2;
            return [series.x[10], rowAt(series, middle).x, series.x[11]];
        }"""
    )
    assert found[1] == pytest.approx((found[0] + found[2]) / 2)


def test_the_point_under_the_mouse_is_found_on_the_ground(page: BrowserPage) -> None:
    found = inside(
        page,
        """(() => {
            const { stage } = views;
            const at = stage.eye.aim.clone().set(4, 1, 0).project(stage.eye.camera);
            return stage.hit((at.x + 1) / 2 * stage.width, (1 - at.y) / 2 * stage.height).place;
        })()""",
    )
    assert found == pytest.approx([4.0, 1.0], abs=1e-3)


def test_a_drag_looks_around_and_the_wheel_comes_nearer(page: BrowserPage) -> None:
    inside(page, "(views.choose('3d', false), views.look('chase'))")
    box = page.locator("#stage").bounding_box()
    assert box is not None
    sky = box["x"] + 0.5 * box["width"], box["y"] + 60
    page.mouse.move(*sky)
    page.mouse.down()
    page.mouse.move(sky[0] + 90, sky[1], steps=3)
    turned = inside(page, "views.stage.eye.azimuth")
    page.mouse.move(sky[0] + 190, sky[1], steps=3)
    page.mouse.up()
    assert inside(page, "views.stage.eye.mode") == "orbit"
    assert inside(page, "views.stage.eye.azimuth") == pytest.approx(turned - 0.7, abs=1e-6)
    far = inside(page, "views.stage.eye.distance")
    page.mouse.wheel(0, -300)
    until(page, f"views.stage.eye.distance < {0.8 * far}")
    page.mouse.move(sky[0] + 10, sky[1], steps=2)
    assert inside(page, "views.stage.eye.azimuth") == pytest.approx(turned - 0.7, abs=1e-6), (
        "no button is down"
    )
    inside(page, "views.look('chase')")


def test_what_happened_is_on_the_slider_and_a_click_goes_there(page: BrowserPage) -> None:
    marks = page.locator("#marks button")
    kinds = [mark.get_attribute("data-kind") for mark in marks.all()]
    assert sorted(filter(None, kinds)) == ["fell", "hand_over", "push", "reached"]
    page.locator("#marks [data-kind=reached]").click()
    assert inside(page, "player.bag.time") == pytest.approx(4.0, abs=0.1)
    page.locator("#tab-events").click()
    page.locator("#event-list button", has_text="1.0 s").click()
    assert inside(page, "player.bag.time") == pytest.approx(1.0, abs=0.1)


def test_a_moment_of_the_charts_is_the_same_on_map_and_ground(page: BrowserPage) -> None:
    page.locator("#span").select_option("5")
    box = page.locator("#charts").bounding_box()
    assert box is not None
    # The gutter with the names takes 122 pixels, and 10 are free on the right.
    wide = box["width"] - 132
    page.mouse.move(box["x"] + 122 + 0.6 * wide, box["y"] + 20)
    until(page, "views.stage.world.spot.visible")
    assert inside(page, "views.stage.world.spot.position.x") == pytest.approx(6.0, abs=0.2)
    page.mouse.click(box["x"] + 122 + 0.5 * wide, box["y"] + 20)
    assert inside(page, "player.bag.time") == pytest.approx(2.5, abs=0.05)
    page.mouse.wheel(0, 400)
    expect(page.locator("#span option:checked")).to_have_text("9 s")
    page.mouse.move(10, 10)
    until(page, "!views.stage.world.spot.visible")


def test_a_path_lies_on_the_ground(page: BrowserPage) -> None:
    drawn = inside(
        page,
        """(() => {
            const { world } = views.stage;
            world.follow([[0, 0], [5, 0], [5, 5]]);
            const faces = world.course.mesh.geometry.drawRange.count;
            world.follow([]);
            return [faces, world.course.mesh.geometry.drawRange.count];
        })()""",
    )
    assert drawn == [12, 0], "two pieces of two triangles"


def ink(page: BrowserPage) -> list[int]:
    """Count the map's pixels of the goals' colour above and below the goal at (8, 0), by 0.7 m."""
    counts: list[int] = page.evaluate(
        """async () => {
            const { view } = await import("/web/main.js");
            const { colours } = await import("/web/theme.js");
            const probe = new OffscreenCanvas(1, 1).getContext("2d");
            probe.fillStyle = colours.good;
            probe.fillRect(0, 0, 1, 1);
            const want = probe.getImageData(0, 0, 1, 1).data;
            const map = document.getElementById("map");
            const ratio = map.width / map.clientWidth;
            return [0.7, -0.7].map((up) => {
                const [x, y] = view.toScreen(8, up).map((one) => Math.round(one * ratio));
                const { data } = map.getContext("2d").getImageData(x - 4, y - 4, 9, 9);
                let found = 0;
                for (let n = 0; n < data.length; n += 4) {
                    found += [0, 1, 2].every((at) => Math.abs(data[n + at] - want[at]) < 40);
                }
                return found;
            });
        }"""
    )
    return counts


@pytest.mark.parametrize("arrival", [math.pi / 2, None])
def test_a_goal_has_an_arrow_where_a_heading_was_asked_for(
    browser: BrowserContext, tmp_path: Path, arrival: float | None
) -> None:
    bag = write_bag(tmp_path / "bag", arrival=arrival)
    with (
        served_page([bag], tmp_path / "web") as address,
        opened(browser, address, "bag") as page,
    ):
        until(page, "player.bag !== null && views.stage !== null")
        inside(page, "(views.choose('map', false), player.seek(2))")
        until(page, "player.bag.goal?.length >= 2")
        drawn(page)
        arrow = "views.stage.world.goals.getObjectByName('arrival')?.rotation.z ?? null"
        # Reads the 2D map first: 3D is drawn while it is the main picture.
        assert [many > 0 for many in ink(page)] == [arrival is not None] * 2
        inside(page, "views.choose('3d', false)")
        until(page, "views.stage.world.goals.children.length === 1")
        assert inside(page, arrow) == (
            None if arrival is None else pytest.approx(arrival, abs=1e-4)
        )
        page.screenshot(path=str(tmp_path / "arrival.png"))


def test_the_path_of_a_recorded_ride_is_drawn_while_it_was_followed(
    browser: BrowserContext, tmp_path: Path
) -> None:
    bag = write_bag(tmp_path / "bag", course=True)
    faces = "views.stage.world.course.mesh.geometry.drawRange.count"
    with (
        served_page([bag], tmp_path / "web") as address,
        opened(browser, address, "bag") as page,
    ):
        until(page, "player.bag !== null && views.stage?.bicycle")
        for time, there in ((2.0, True), (0.5, False), (1.1, True), (3.5, False)):
            inside(page, f"player.seek({time})")
            until(page, f"({faces} > 100) === {str(there).lower()}")


def test_a_second_ride_comes_along_translucent(page: BrowserPage) -> None:
    page.locator("#compare").click()
    page.locator("#bag-list button").first.click()
    until(page, "views.stage.others.ghost?.bicycle.group.visible")
    expect(page.locator("#gap")).to_contain_text(re.compile("level with|beside"))
    page.locator("#compare").click()
    expect(page.locator("#gap")).to_be_hidden()
    until(page, "!views.stage.others.ghost.bicycle.group.visible")


def test_the_estimate_is_shown_beside_the_truth(browser: BrowserContext, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", estimated=True)
    with (
        served_page([bag], tmp_path / "web") as address,
        opened(browser, address, "bag") as page,
    ):
        until(page, "player.bag !== null && views.stage !== null")
        inside(page, "player.seek(0.5)")
        until(page, "views.stage.bicycle !== null && !views.stage.others.estimate")
        expect(page.locator("#loop")).not_to_contain_text("estimate")
        inside(page, "player.seek(3)")
        until(page, "views.stage.others.estimate?.bicycle.group.visible")
        place = inside(page, "views.stage.others.estimate.bicycle.group.position.toArray()")
        assert place == pytest.approx([6.0, 0.2, 0.0])
        expect(page.locator("#loop")).to_contain_text("estimate off by5.73°, 0.20 m")
        page.screenshot(path=str(tmp_path / "estimate.png"))


SIZES = {"width": [1440, 1280, 820, 390, 844], "height": [900, 720, 1180, 844, 390]}


def overlap(one: FloatRect, other: FloatRect) -> bool:
    """Return True if two boxes of the page have a part in common."""
    across = one["x"] < other["x"] + other["width"] and other["x"] < one["x"] + one["width"]
    down = one["y"] < other["y"] + other["height"] and other["y"] < one["y"] + one["height"]
    return across and down


def test_a_banner_says_the_trouble_alone_and_covers_no_guide(page: BrowserPage) -> None:
    text = page.evaluate(
        """async () => {
            const { tellLive } = await import("/web/who.js");
            const rider = { label: "DDPG actor", kind: "a neural network", name: "p" };
            const who = { driver: rider, chosen: rider, why: "", since: NaN, stop: false };
            const misfit = "it was trained at another speed";
            const status = { who, trouble: "", goal: null, misfit };
            const told = tellLive({ mode: "riding", status }, "");
            const banner = document.getElementById("alarm").cloneNode();
            Object.assign(banner, { hidden: false, textContent: told.alarm, id: "" });
            banner.dataset.level = told.level;
            const guide = document.getElementById("guide").cloneNode(true);
            Object.assign(guide, { hidden: false, id: "", className: "guide" });
            guide.dataset.copy = banner.dataset.copy = "1";
            document.getElementById("ride").append(banner, guide);
            return [told.text, told.alarm];
        }"""
    )
    assert text[1] == "DDPG actor does not suit this ride: it was trained at another speed."
    assert text[0].endswith(text[1])
    assert len(text[0]) > 2 * len(text[1])
    for width, height in zip(*SIZES.values(), strict=True):
        page.set_viewport_size({"width": width, "height": height})
        banner = page.locator(".alarm[data-copy]").bounding_box()
        guide = page.locator(".guide[data-copy]").bounding_box()
        assert banner is not None
        assert guide is None or not overlap(banner, guide), (width, height)
        assert banner["height"] < 70, "two lines, so that the rider is seen"
    page.evaluate("() => document.querySelectorAll('[data-copy]').forEach((one) => one.remove())")
    page.set_viewport_size({"width": 1280, "height": 800})


def test_the_banner_and_the_legend_do_not_overlap(page: BrowserPage) -> None:
    page.evaluate(
        """() => {
            const banner = document.getElementById("alarm");
            Object.assign(banner.dataset, { level: "warn", test: "1" });
            window.showBanner = () => {
                banner.hidden = false;
                banner.textContent = "LQR took over: " + "it leaned too fast, ".repeat(3);
            };
        }"""
    )
    assert page.locator("#legend li").count() > 0
    for width, height in zip(*SIZES.values(), strict=True):
        page.set_viewport_size({"width": width, "height": height})
        drawn(page)
        boxes = page.evaluate(
            """() => {
                showBanner();
                const found = ["alarm", "legend"].map((id) => document.getElementById(id));
                return found.map((one) => one.getBoundingClientRect().toJSON());
            }"""
        )
        banner, legend = boxes
        assert banner["height"] > 0
        apart = legend["top"] >= banner["bottom"] or legend["bottom"] <= banner["top"]
        assert apart or legend["height"] == 0, (width, height)
    page.set_viewport_size({"width": 1280, "height": 800})
    drawn(page)


def test_the_numbers_of_the_map_are_covered_by_nothing(page: BrowserPage) -> None:
    inside(page, "(views.choose('map', false), player.seek(4.5))")
    try:
        for width, height in zip(*SIZES.values(), strict=True):
            page.set_viewport_size({"width": width, "height": height})
            drawn(page)
            assert page.evaluate(COVERED) == [], (width, height)
    finally:
        inside(page, "views.choose('3d', false)")
        page.set_viewport_size({"width": 1280, "height": 800})


COVERED = """async () => {
    const { parts } = await import("/web/main.js");
    const map = document.getElementById("map");
    const context = map.getContext("2d");
    const written = [];
    context.fillText = function (text, x, y) {
        const wide = this.measureText(text).width;
        written.push({ text, left: x, right: x + wide, top: y - 9, bottom: y });
    };
    parts.flat();
    delete context.fillText;
    const numbers = written.filter(({ text }) => /^(-?[0-9]+|m)$/.test(text));
    const on = map.getBoundingClientRect();
    const over = [...document.querySelectorAll("#legend, .zoom")]
        .map((one) => ({ one, box: one.getBoundingClientRect() }))
        .filter(({ box }) => box.height)
        .map(({ one, box }) => ({ text: one.className, left: box.left - on.left,
            right: box.right - on.left, top: box.top - on.top, bottom: box.bottom - on.top }));
    const meet = (a, b) => a.left < b.right && b.left < a.right
        && a.top < b.bottom && b.top < a.bottom;
    const unit = numbers.find(({ text }) => text === "m");
    const all = [...over, unit];
    return numbers.filter((one) => all.some((other) => other !== one && meet(one, other)))
        .map(({ text }) => text);
}"""


def test_the_horizon_is_as_new_as_the_numbers(page: BrowserPage) -> None:
    filled = page.evaluate(
        """async () => {
            const { parts } = await import("/web/main.js");
            const canvas = document.getElementById("horizon");
            const context = canvas.getContext("2d");
            const count = () => context.getImageData(0, 0, canvas.width, canvas.height).data
                .reduce((sum, one) => sum + (one > 0), 0);
            context.setTransform(1, 0, 0, 1, 0, 0);
            context.clearRect(0, 0, canvas.width, canvas.height);
            const before = count();
            parts.flat();
            return [before, count()];
        }"""
    )
    assert filled[0] == 0
    assert filled[1] > 1000


@pytest.fixture(scope="module")
def race(
    browser: BrowserContext, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[BrowserPage]:
    """Yield the page with a ride of two pushes, its ghost, and the guide of the first minute."""
    folder = tmp_path_factory.mktemp("race")
    with (
        served_page([RIDE], folder, against="lqr") as address,
        opened(browser, address, "bag") as result,
    ):
        until(result, "player.bag !== null && views.stage !== null")
        result.locator("#compare").click()
        result.locator("#bag-list button", has_text="by lqr").click()
        expect(result.locator("#gap")).to_be_visible()
        result.evaluate(
            """async () => {
                const { STEPS } = await import("/web/guide.js");
                const items = Object.values(STEPS).map((textContent) =>
                    Object.assign(document.createElement("li"), { textContent }));
                document.getElementById("guide-steps").replaceChildren(...items);
                const guide = document.getElementById("guide");
                Object.assign(guide, { hidden: false, className: "guide" });
            }"""
        )
        yield result


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("at", range(5))
def test_pictures_of_3d_with_a_ghost_are_kept(race: BrowserPage, at: int, scheme: Any) -> None:
    width, height = SIZES["width"][at], SIZES["height"][at]
    race.emulate_media(color_scheme=scheme)
    race.set_viewport_size({"width": width, "height": height})
    inside(race, "player.seek(9.5)")
    drawn(race)
    number = inside(race, "views.stage.renderer.info.render.frame")
    inside(race, "player.seek(9.6)")
    until(race, f"views.stage.renderer.info.render.frame > {number}")
    drawn(race)
    assert race.evaluate("() => document.documentElement.scrollWidth") <= width
    assert len(set(shown(race))) > 2
    shoot(race, f"3d-{width}-{scheme}")


def test_on_a_phone_the_guide_is_one_line_with_the_next_step(
    page: BrowserPage, tmp_path: Path
) -> None:
    page.set_viewport_size({"width": 390, "height": 844})
    page.evaluate(
        """async () => {
            const { STEPS } = await import("/web/guide.js");
            const item = (textContent) =>
                Object.assign(document.createElement("li"), { textContent });
            const guide = document.getElementById("guide").cloneNode(true);
            Object.assign(guide, { hidden: false, id: "", className: "guide" });
            guide.dataset.copy = "1";
            guide.querySelector("ol").replaceChildren(...Object.values(STEPS).map(item));
            guide.querySelector("li").className = "done";
            document.getElementById("ride").append(guide);
        }"""
    )
    guide, picture = page.locator(".guide[data-copy]"), page.locator("#stage").bounding_box()
    box = guide.bounding_box()
    assert box is not None
    assert picture is not None
    assert box["y"] + box["height"] < picture["y"] + 0.3 * picture["height"], "above the rider"
    assert [step.is_visible() for step in guide.locator("li").all()] == [False, True, False, False]
    page.screenshot(path=str(tmp_path / "guide-phone.png"))
    guide.evaluate("(one) => one.remove()")
    page.set_viewport_size({"width": 1280, "height": 800})


@pytest.mark.parametrize("width", [1280, 1440])
def test_beside_a_banner_the_guide_is_one_line_too(race: BrowserPage, width: int) -> None:
    race.set_viewport_size({"width": width, "height": 800})
    inside(race, "player.seek(9.6)")
    expect(race.locator("#alarm")).to_be_visible()
    steps = race.locator("#guide li").all()
    assert [step.is_visible() for step in steps] == [True, False, False, False]
    guide = race.locator("#guide").bounding_box()
    assert guide is not None
    assert guide["height"] < 60
    buttons = race.locator(".zoom").bounding_box()
    assert buttons is not None
    assert not overlap(guide, buttons)
    inside(race, "player.seek(0.0)")


def test_the_legend_covers_no_button(page: BrowserPage) -> None:
    page.locator("#compare").click()
    page.locator("#bag-list button").first.click()
    expect(page.locator("#gap")).to_be_visible()
    for width, height in zip(*SIZES.values(), strict=True):
        page.set_viewport_size({"width": width, "height": height})
        legend = page.locator("#legend").bounding_box()
        buttons = page.locator(".zoom").bounding_box()
        assert buttons is not None
        if legend is None:  # while a banner takes its place
            continue
        beside = legend["x"] + legend["width"] <= buttons["x"]
        assert beside or legend["y"] >= buttons["y"] + buttons["height"], (width, height)
    page.set_viewport_size({"width": 1280, "height": 800})
    page.locator("#compare").click()


GAP = """async (ahead) => {
    const { Ghost } = await import("/web/ghost.js");
    const { Series } = await import("/web/series.js");
    // Two rides to a goal at 10 m and another 10 m after it, at 2 m/s; the ghost starts later.
    const ride = (delay) => {
        const series = new Series(["t", "episode", "step", "goal_distance"]);
        const rows = Array.from({ length: 600 }, (_, n) => {
            const way = Math.max(0, 0.025 * n - delay) * 2;
            return [0.025 * n, 1, n, way < 10 ? 10 - way : Math.max(0, 20 - way)];
        });
        series.push(rows, 0);
        const goal = (t, kind) => ({ t, kind, x: 10, y: 0 });
        const marks = [goal(0, "active"), goal(5 + delay, "reached"), goal(5 + delay, "active")];
        return { series, marks, events: marks };
    };
    const own = ride(0);
    const ghost = new Ghost(ride(ahead), () => "red");
    const { series, marks } = own;
    const gap = (time) => ghost.gap(series, series.indexAt(time), time, marks);
    return [0.4, 4, 5, 7, 9].map(gap);
}"""


@pytest.mark.parametrize("delay", [0.0, 0.5, 2.0])
def test_the_gap_is_the_time_between_equal_progress(page: BrowserPage, delay: float) -> None:
    gaps = page.evaluate(GAP, delay)
    assert gaps == pytest.approx([-delay] * len(gaps), abs=0.25)


def test_the_page_makes_a_film(page: BrowserPage) -> None:
    page.locator("#film").click()
    expect(page.locator("#film")).to_have_text("Save film")
    page.locator("#play").click()
    page.wait_for_timeout(700)
    with page.expect_download() as download:
        page.locator("#film").click()
    assert download.value.suggested_filename.endswith(".webm")
    assert download.value.path().read_bytes()[:4] == b"\x1aE\xdf\xa3"
    expect(page.locator("#film")).to_have_text("Film")


def test_the_choice_of_the_main_picture_is_kept(page: BrowserPage) -> None:
    page.keyboard.press("m")
    expect(page.locator("#ride")).to_have_attribute("data-main", "map")
    page.reload()
    expect(page.locator("#swap")).to_have_text("3D")
    expect(page.locator("#ride")).to_have_attribute("data-main", "map")
    page.locator("#swap").click()
    expect(page.locator("#ride")).to_have_attribute("data-main", "3d")


def test_a_processor_that_draws_gets_one_picture_at_a_time(page: BrowserPage) -> None:
    """Else its queue grows on a busy machine, and the page answers no click for minutes."""
    inside(page, "views.choose('3d', false)")
    until(page, "views.stage.ready(performance.now())")
    asked = page.evaluate(
        """async () => {
            const { views, parts } = await import("/web/main.js");
            parts.stage();
            return [views.stage.soft, views.stage.ready(performance.now())];
        }"""
    )
    assert asked == [True, False]
    until(page, "views.stage.ready(performance.now())")
    assert inside(page, "views.stage.rest > views.stage.last"), "others get a turn"


def test_a_browser_without_webgl_shows_the_map(browser: BrowserContext, address: str) -> None:
    result = browser.new_page()
    result.add_init_script(
        """const before = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
            return kind.startsWith("webgl") ? null : before.call(this, kind, ...more);
        };"""
    )
    result.goto(address)
    expect(result.locator("#mode")).to_have_text("bag")
    expect(result.locator("#swap")).to_be_disabled()
    expect(result.locator("#ride")).to_have_attribute("data-main", "map")
    assert "no WebGL" in (result.locator("#swap").get_attribute("title") or "")
    result.close()


def test_the_small_pictures_have_the_sizes_of_the_ridden_bicycle(page: BrowserPage) -> None:
    sizes: dict[str, list[float]] = page.evaluate(
        """async () => {
          const { drawAbove, drawBehind } = await import("/web/bike.js");
          const canvas = document.getElementById("behind");
          const kind = CanvasRenderingContext2D.prototype;
          const found = { ellipses: [], lines: [] };
          const { ellipse, lineTo } = kind;
          kind.ellipse = function (...words) {
            found.ellipses.push(words[3]);
            ellipse.apply(this, words);
          };
          kind.lineTo = function (x, y) { found.lines.push(y); lineTo.call(this, x, y); };
          const geometry = { wheelbase: 3.0, rear_radius: 0.251, front_radius: 0.301 };
          drawBehind(canvas, { lean: 0, steer: 0 }, 0.5, geometry);
          drawAbove(canvas, { lean: 0, steer: 0 }, geometry);
          const before = found.ellipses.length;
          drawBehind(canvas, undefined, 0.5, undefined);
          drawAbove(canvas, undefined, undefined);
          Object.assign(kind, { ellipse, lineTo });
          return { ...found, unknown: [found.ellipses.length - before] };
        }"""
    )
    # From behind a wheel is an ellipse of its radius, from above a line.
    assert sizes["ellipses"][:2] == [0.301, 0.251]
    assert {1.751, 0.301} <= set(sizes["lines"])
    assert sizes["unknown"] == [0]
