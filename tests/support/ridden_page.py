"""Fixtures: a cockpit with its own ride, and its page in a Chromium, waiting at the origin."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import pytest
from chromium import (
    BrowserContext,
    BrowserPage,
    Page,
    Started,
    chromium,
    cockpit,
    expect,
    inside,
    opened,
    place,
    position,
    until,
)

from bicycle_cockpit.ride_state import HISTORY


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
