"""The page has every row once: after a reload, in a second browser, after a lost connection."""

from __future__ import annotations

import pytest
from chromium import (
    BrowserPage,
    Started,
    inside,
    ridden,
    said,
    until,
)
from ridden_page import hole, ride, steps_of, whole

pytest_plugins = ["ridden_page"]
pytestmark = [pytest.mark.ros, pytest.mark.slow]

RELOADS = 12


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
