"""Places and colours of all that is drawn, in a real browser over a real ride."""

from __future__ import annotations

import itertools
import re
from functools import partial
from typing import Any

import pytest
import waiting
from chromium import (
    BrowserContext,
    BrowserPage,
    Page,
    Started,
    cockpit,
    drawn,
    expect,
    inside,
    opened,
)
from ridden_page import fall, ride, whole

from bicycle_cockpit.riders import label

pytest_plugins = ["ridden_page"]
pytestmark = [pytest.mark.ros, pytest.mark.slow]

VARIABLE = "(name) => getComputedStyle(document.body).getPropertyValue(name)"
"""Value of a variable of the style sheet."""
WIDTHS = (320, 360, 390, 500, 640, *range(641, 1060, 20), 1100, 1280, 1440)


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
    """The widths are 320 to 1,440 px; 200 % zoom of a laptop's 1,280 or 1,440 px makes 640 and
    720."""
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
    try:
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            mine = page.evaluate(legend)
            assert len(set(mine.values())) == len(mine) >= len(names)
            card, goal = (page.evaluate(VARIABLE, name).strip() for name in ("--card", "--good"))
            # At once: a page behind another is neither drawn nor told of another scheme.
            assert all(contrast(_hex(colour), card) >= 3.0 for colour in mine.values()), scheme
            assert goal not in {_hex(colour) for colour in mine.values()}
    finally:
        page.emulate_media(color_scheme="light")


def test_the_canvases_follow_a_scheme_of_which_nobody_tells(page: BrowserPage) -> None:
    # Chromium does not always tell a page of another scheme; here it never does.
    page.add_init_script("MediaQueryList.prototype.addEventListener = function () {};")
    page.reload()
    whole(page)
    try:
        for scheme in ("dark", "light"):
            page.emulate_media(color_scheme=scheme)
            waiting.until(partial(_has_card_of_the_scheme, page))
    finally:
        page.emulate_media(color_scheme="light")


def _has_card_of_the_scheme(page: BrowserPage) -> bool:
    """Return True if the canvases' colour of a card is the style sheet's."""
    colour: str = page.evaluate("""async () => (await import("/web/theme.js")).colours.card""")
    card: str = page.evaluate(VARIABLE, "--card")
    return colour == card.strip()


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
    page.reload()  # Chromium does not always tell a page of another scheme
    try:
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


def test_a_tab_that_comes_back_has_the_colours_of_now(page: BrowserPage) -> None:
    """Browsers do not tell a tab in the background that the scheme changes."""
    found = page.evaluate(
        """async () => {
            const { colours } = await import("/web/theme.js");
            const before = colours.accent;
            document.documentElement.style.setProperty("--accent", "#123456");
            document.dispatchEvent(new Event("visibilitychange"));
            const after = colours.accent;
            document.documentElement.style.removeProperty("--accent");
            document.dispatchEvent(new Event("visibilitychange"));
            return [before, after, colours.accent];
        }"""
    )
    assert found[1] == "#123456"
    assert found[0] == found[2] != found[1]
