"""The ride report in a real browser: what a person sees of its tables."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from report_bag import write

from bicycle_tools.report_page.command import main

ROOT = Path(__file__).resolve().parents[2]
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")

if not CHROMIUM and not os.environ.get("CI"):
    pytest.skip(
        "no Chromium here for the browser tests: sudo apt-get install -y chromium",
        allow_module_level=True,
    )

from playwright.sync_api import Page, expect, sync_playwright  # noqa: E402

expect.set_options(timeout=60_000)
pytestmark = pytest.mark.slow

CUT_OFF = """() => [...document.querySelectorAll(".wide")]
    .filter(box => box.scrollWidth > box.clientWidth + 1).map(box => box.innerText)"""


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """Yield a report of two bags."""
    assert CHROMIUM, "CI must have Chromium: .ci/run installs it"
    folder = tmp_path_factory.mktemp("report")
    bags = [write(folder / "my-ride"), ROOT / "tests" / "data" / "film-ride"]
    page = folder / "both.html"
    assert main([*map(str, bags), "--output", str(page)]) == 0
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as profile:
        context = playwright.chromium.launch_persistent_context(
            profile,
            executable_path=CHROMIUM,
            args=["--headless", "--no-sandbox", "--disable-gpu"],
            viewport={"width": 1280, "height": 800},
        )
        tab = context.new_page()
        errors: list[str] = []
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.on("console", lambda line: errors.append(line.text) if line.type == "error" else None)
        tab.goto(page.as_uri())
        yield tab
        assert not errors, errors
        context.close()


def test_no_column_of_two_bags_is_cut_off(shown: Page) -> None:
    """A laptop shows 1,280 pixels."""
    assert shown.locator(".columns th", has_text="per second").count() == 2
    assert shown.evaluate(CUT_OFF) == []


def window(page: Page) -> tuple[float, float]:
    """Return the time that is shown, s."""
    box = page.locator(".explorer")
    return float(box.get_attribute("data-from") or 0), float(box.get_attribute("data-to") or 0)


def cursor(page: Page) -> str:
    return page.locator(".explorer").get_attribute("data-cursor") or ""


def test_rides_lie_over_each_other_and_are_zoomed(shown: Page) -> None:
    strips = shown.locator(".strips")
    strips.scroll_into_view_if_needed()
    box = strips.bounding_box()
    assert box is not None
    first, last = window(shown)
    assert first == 0.0
    assert last == pytest.approx(37.5, abs=0.1), "the longer of both"
    middle = box["x"] + 0.5 * box["width"], box["y"] + 100
    shown.mouse.move(*middle)
    assert float(cursor(shown)) == pytest.approx(18.75, rel=0.1)
    shown.mouse.click(*middle)
    shown.mouse.wheel(0, -600)
    expect(shown.locator(".explorer")).not_to_have_attribute("data-to", f"{last:.3f}")
    zoomed = window(shown)
    assert zoomed[1] - zoomed[0] < 0.5 * last
    assert zoomed[0] < float(cursor(shown)) < zoomed[1]
    shown.mouse.down()
    shown.mouse.move(middle[0] - 200, middle[1], steps=4)
    shown.mouse.up()
    moved = window(shown)
    assert moved[0] > zoomed[0] + 1.0, "a drag to the left shows later"
    assert moved[1] - moved[0] == pytest.approx(zoomed[1] - zoomed[0], abs=0.01)
    shown.keyboard.press("0")
    assert window(shown) == (first, last)
    shown.keyboard.press("+")
    assert window(shown)[1] - window(shown)[0] == pytest.approx(last / 1.6, abs=0.01)
    shown.locator("[data-zoom=all]").click()


def test_marks_are_reached_one_after_the_other_and_said(shown: Page) -> None:
    shown.locator(".strips").focus()
    shown.keyboard.press("Escape")
    found = []
    for _ in range(8):
        shown.keyboard.press("n")
        found.append(shown.locator(".moment").inner_text())
    text = "\n".join(found)
    assert "film-ride: pushed to the right, 0.40 rad/s" in text
    assert "film-ride: hand-over" in text
    assert "my-ride: fell at" in text
    assert "goal (-13.4, -0.0) reached" in text
    before = float(cursor(shown))
    shown.keyboard.press("p")
    assert float(cursor(shown)) < before


def test_a_phone_shows_it_all_without_scrolling_sideways(shown: Page) -> None:
    shown.set_viewport_size({"width": 390, "height": 844})
    shown.reload()
    assert shown.evaluate("() => document.documentElement.scrollWidth") == 390
    assert shown.evaluate(CUT_OFF) == []
    assert shown.locator("details.still[open]").count() == 0
    heads = shown.locator("td[data-head='took (s)']").first
    content = heads.evaluate("(cell) => getComputedStyle(cell, '::before').content")
    assert content == '"took (s)"'
