"""The ride report in a real browser: what a person sees of its tables."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

import pytest
from report_bag import write

from bicycle_tools.report_page.command import main

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")

if not CHROMIUM and not os.environ.get("CI"):
    pytest.skip(
        "no Chromium here for the browser tests: sudo apt-get install -y chromium",
        allow_module_level=True,
    )

from playwright.sync_api import sync_playwright  # noqa: E402

pytestmark = pytest.mark.slow

CUT_OFF = """() => [...document.querySelectorAll(".wide")]
    .filter(box => box.scrollWidth > box.clientWidth + 1).map(box => box.innerText)"""


def test_no_column_of_two_bags_is_cut_off(tmp_path: Path) -> None:
    """A laptop shows 1,280 pixels."""
    assert CHROMIUM, "CI must have Chromium: .ci/run installs it"
    bags = [write(tmp_path / name) for name in ("my-ride", "other-ride")]
    page = tmp_path / "both.html"
    assert main([*map(str, bags), "--output", str(page)]) == 0
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as profile:
        context = playwright.chromium.launch_persistent_context(
            profile,
            executable_path=CHROMIUM,
            args=["--headless", "--no-sandbox", "--disable-gpu"],
            viewport={"width": 1280, "height": 800},
        )
        shown = context.new_page()
        shown.goto(page.as_uri())
        heads = shown.locator(".columns th", has_text="per second")
        assert heads.count() == 2
        assert shown.evaluate(CUT_OFF) == []
        context.close()
