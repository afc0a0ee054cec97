"""The page and the ride report, looked through by axe-core: WCAG 2.2 A and AA, best practice."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from axe_rules import problems
from chromium import BrowserContext, BrowserPage, chromium, expect, opened, until
from made_bag import write_bag
from served_page import served_page

from bicycle_tools.report_page.command import main as write_report

pytestmark = pytest.mark.slow

SIZES = {"laptop": (1440, 900), "phone": (390, 844)}


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("bag") / "ride")


@pytest.fixture(scope="module")
def browser() -> Iterator[BrowserContext]:
    """A Chromium on its first visit."""
    with chromium(main="") as context:
        yield context


@pytest.fixture(scope="module")
def page(browser: BrowserContext, bag: Path, tmp_path_factory: Any) -> Iterator[BrowserPage]:
    """The page with a ride and its ghost."""
    with (
        served_page([bag], tmp_path_factory.mktemp("page")) as address,
        opened(browser, address, "bag") as tab,
    ):
        until(tab, "player.bag !== null && views.stage !== null")
        tab.locator("#compare").click()
        tab.locator("#bag-list button").first.click()
        expect(tab.locator("#gap")).to_be_visible()
        yield tab


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", SIZES)
def test_the_page_breaks_no_rule(page: BrowserPage, size: str, scheme: Any) -> None:
    page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
    page.set_viewport_size({"width": SIZES[size][0], "height": SIZES[size][1]})
    assert problems(page) == []


@pytest.mark.parametrize("dialog", ["bag", "help", "setup"])
def test_its_dialogs_break_no_rule(page: BrowserPage, dialog: str) -> None:
    page.set_viewport_size({"width": 1440, "height": 900})
    if dialog == "setup":  # there is no live ride to set up
        page.evaluate("() => document.getElementById('setup').showModal()")
    else:
        page.locator(f"#{dialog}").click()
    assert problems(page) == []
    page.keyboard.press("Escape")


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", SIZES)
def test_the_ride_report_breaks_no_rule(
    browser: BrowserContext, bag: Path, tmp_path: Path, size: str, scheme: Any
) -> None:
    file = tmp_path / "report.html"
    assert write_report([str(bag), str(bag), "--output", str(file)]) == 0
    tab = browser.new_page()
    tab.emulate_media(color_scheme=scheme)
    tab.set_viewport_size({"width": SIZES[size][0], "height": SIZES[size][1]})
    tab.goto(file.as_uri())
    assert problems(tab) == []
    tab.close()
