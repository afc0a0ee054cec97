"""Debian's Chromium, headless, with a page of the cockpit in it."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from cockpit_page import COCKPIT, Page, address_of
from domains import claimed_domain
from node_process import NodeProcess
from waiting import PATIENCE
from waiting import until as waited

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
if not CHROMIUM and not os.environ.get("CI"):
    pytest.skip(
        "no Chromium here for the browser tests: sudo apt-get install -y chromium",
        allow_module_level=True,
    )

from playwright.sync_api import (  # noqa: E402
    BrowserContext,
    Playwright,
    ViewportSize,
    expect,
    sync_playwright,
)
from playwright.sync_api import Page as BrowserPage  # noqa: E402

LONG = 1000 * PATIENCE
"""ms."""
expect.set_options(timeout=LONG)

MAIN = "bicycle-cockpit-main"
"""Key under which the page stores its large picture."""
GUIDE = "bicycle-cockpit-guide"
"""Key under which it stores that the guide of the first minute is done."""
SHOTS = Path(os.environ.get("BICYCLE_SCREENSHOTS", COCKPIT.parent / "runs" / "screenshots"))
"""Folder in which pictures of the page are kept."""
WIDE: ViewportSize = {"width": 1280, "height": 800}
Started = tuple[str, NodeProcess, int]
"""Address, process and domain of a cockpit."""


@contextmanager
def chromium(main: str = "map") -> Iterator[BrowserContext]:
    """A Chromium with a profile of its own.

    Args:
        main: the picture that pages show large, as a person chose it before; empty for the first
            visit. The map, unless 3D is what is tested: without a graphics card 3D takes the
            processor from the ride.
    """
    with sync_playwright() as playwright, another(playwright, main) as context:
        yield context


@contextmanager
def another(playwright: Playwright, main: str = "map") -> Iterator[BrowserContext]:
    """One more Chromium, which knows nothing of the others."""
    assert CHROMIUM, "CI must have Chromium: .ci/run installs it"
    with tempfile.TemporaryDirectory() as profile:
        context = playwright.chromium.launch_persistent_context(
            profile, executable_path=CHROMIUM, args=FLAGS, viewport=WIDE
        )
        context.set_default_timeout(LONG)
        if main:
            script = (
                f"localStorage.setItem('{MAIN}', '{main}'); localStorage.setItem('{GUIDE}', 'off')"
            )
            context.add_init_script(script)
        yield context
        context.close()


@contextmanager
def cockpit(*words: str) -> Iterator[Started]:
    """A cockpit with its own ride."""
    command = [str(COCKPIT), "--port", "0", *words]
    with claimed_domain() as domain:
        environment = {"ROS_DOMAIN_ID": str(domain)}
        with NodeProcess(command, environment) as process:
            yield address_of(process), process, domain


@contextmanager
def opened(context: BrowserContext, address: str, mode: str = "") -> Iterator[BrowserPage]:
    """The page, connected; nothing that it logs as an error is forgiven.

    Args:
        context: the browser.
        address: of the cockpit.
        mode: what the badge must come to say.
    """
    page = context.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda line: errors.append(line.text) if line.type == "error" else None)
    page.goto(address)
    if mode:
        expect(page.locator("#mode")).to_have_text(mode)
    yield page
    found = [line for line in errors if "WebSocket connection to" not in line]
    assert not found, found
    page.close()


def shoot(page: BrowserPage, name: str, **more: Any) -> None:
    """Keep a picture of the page."""
    SHOTS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=str(SHOTS / f"{name}.png"), **more)


def place(page: BrowserPage, across: float, down: float) -> tuple[float, float]:
    """Return a point of the map, given as shares of its width and height."""
    box = page.locator("#map").bounding_box()
    assert box is not None
    return box["x"] + across * box["width"], box["y"] + down * box["height"]


def said(page: BrowserPage, pattern: str) -> re.Match[str]:
    """Return the line below the controls, once it matches."""
    return matched(page, "#answer", pattern)


def matched(page: BrowserPage, selector: str, pattern: str) -> re.Match[str]:
    """Return an element's text, once it matches."""
    found = page.locator(selector)
    expect(found).to_have_text(re.compile(pattern))
    match = re.search(pattern, found.inner_text())
    assert match is not None
    return match


def position(page: BrowserPage) -> tuple[float, float]:
    """m, as the head shows it."""
    x, y = page.locator("#position").inner_text().split(",")
    return float(x), float(y)


def inside(page: BrowserPage, expression: str) -> Any:
    """Return a value of the page's own `live`, `view`, `views`, `link`, `fleet` and `player`."""
    script = f"({{ live, view, views, link, fleet, player }}) => {expression}"
    return page.evaluate(f"async () => ({script})(await import('/web/main.js'))")


def until(page: BrowserPage, expression: str) -> None:
    """Wait until something holds of what `inside` knows.

    Playwright's own `wait_for_function` does not ask again after a promise.
    """
    waited(lambda: inside(page, expression))


def ridden(page: BrowserPage, steps: int) -> None:
    """Wait until the page has so many more steps of the ride."""
    newest = inside(page, "live.series.step.at(-1)")
    until(page, f"live.series.step.at(-1) >= {newest + steps}")


def drawn(page: BrowserPage) -> None:
    """Wait until the page has drawn what it knows and as large as it is now."""
    page.evaluate(
        """async () => {
            for (let n = 0; n < 6; n++) {
                dispatchEvent(new Event("resize"));
                await new Promise(requestAnimationFrame);
            }
        }"""
    )


def kept_lines(page: BrowserPage) -> list[str]:
    """Return the texts of the line below the head since the first call."""
    found: list[str] = page.evaluate(
        """() => {
            const line = document.getElementById("who");
            if (!window.keptLines) {
                window.keptLines = [line.innerText];
                const keep = () => window.keptLines.push(line.innerText);
                new MutationObserver(keep).observe(line, { subtree: true, childList: true });
            }
            return window.keptLines;
        }"""
    )
    return found


def saw(page: BrowserPage, pattern: str) -> str:
    """Return the first thing that matches of `kept_lines`; waits for it."""
    kept_lines(page)
    page.wait_for_function(
        "(pattern) => window.keptLines.some((line) => new RegExp(pattern).test(line))",
        arg=pattern,
    )
    return next(line for line in kept_lines(page) if re.search(pattern, line))


__all__ = [
    "SHOTS",
    "BrowserContext",
    "BrowserPage",
    "Page",
    "Started",
    "another",
    "chromium",
    "cockpit",
    "drawn",
    "expect",
    "inside",
    "kept_lines",
    "matched",
    "opened",
    "place",
    "position",
    "ridden",
    "said",
    "saw",
    "shoot",
    "sync_playwright",
    "until",
]
