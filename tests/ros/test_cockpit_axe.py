"""The live cockpit, looked through by axe-core: guide, banner, and each tab."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from axe_rules import problems
from chromium import BrowserPage, chromium, cockpit, expect, opened, until

pytestmark = [pytest.mark.ros, pytest.mark.slow]

SIZES = {"laptop": (1280, 800), "phone": (390, 844)}


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BrowserPage]:
    """Yield the page of a first visit, with a controller that does not suit the ride."""
    folder = tmp_path_factory.mktemp("bags")
    words = "--bags", str(folder), "controller.policy:=learned-speed"
    with (
        chromium(main="") as browser,
        cockpit(*words) as (address, _, _),
        opened(browser, address, "waits for a goal") as result,
    ):
        until(result, "views.stage !== null")
        yield result


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", SIZES)
def test_guide_and_banner_break_no_rule(page: BrowserPage, size: str, scheme: Any) -> None:
    page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
    page.set_viewport_size({"width": SIZES["laptop"][0], "height": SIZES["laptop"][1]})
    expect(page.locator("#alarm")).to_contain_text("does not suit")
    expect(page.locator("#guide")).to_be_visible()
    page.set_viewport_size({"width": SIZES[size][0], "height": SIZES[size][1]})
    assert problems(page) == []


@pytest.mark.parametrize("tab", ["training", "events", "loop"])
def test_each_tab_breaks_no_rule(page: BrowserPage, tab: str) -> None:
    page.set_viewport_size({"width": SIZES["laptop"][0], "height": SIZES["laptop"][1]})
    page.locator(f"#tab-{tab}").click()
    expect(page.locator(f"#{tab}")).to_be_visible()
    assert problems(page) == []


def test_the_form_of_the_ride_breaks_no_rule(page: BrowserPage) -> None:
    page.locator("#set-up").click()
    expect(page.locator("#setup")).to_be_visible()
    assert problems(page) == []
    page.keyboard.press("Escape")
