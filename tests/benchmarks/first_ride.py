"""Waiting time of a newcomer: `cockpit.sh` in a fresh clone, a click, until the bicycle rides.

The repository is cloned into an empty folder, with an empty HOME, so nothing is set up and no
package is in a cache; `ros2_ws/cockpit.sh` is started, the address that it prints is opened in
Chromium, the map is clicked, and it is over when the page shows that the bicycle rides towards
the goal. What is downloaded comes from the package index that pip is set to.

    python tests/benchmarks/first_ride.py [--out FILE] [--picture FILE]
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

from machine import machine
from playwright.sync_api import Page, expect, sync_playwright

from bicycle_controller.training.run_folder import origin

RESULTS = Path(__file__).parent / "results" / "first_ride.json"
ROOT = Path(__file__).resolve().parents[2]
OURS = ("PYTHONPATH", "LD_LIBRARY_PATH", "AMENT_PREFIX_PATH", "VIRTUAL_ENV", "BICYCLE_WS")


def start(folder: Path) -> subprocess.Popen[str]:
    """Return `cockpit.sh` in a fresh clone, by somebody who has nothing."""
    clone, home = folder / "clone", folder / "home"
    home.mkdir()
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
    env = {name: value for name, value in os.environ.items() if name not in OURS}
    return subprocess.Popen(
        [str(clone / "ros2_ws" / "cockpit.sh"), "--port", "0"],
        env={**env, "HOME": str(home)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def said(cockpit: subprocess.Popen[str]) -> tuple[list[str], str]:
    """Return the output up to the page's address, and the address."""
    assert cockpit.stdout is not None
    lines = []
    for line in cockpit.stdout:
        lines.append(line.rstrip())
        if found := re.search(r"cockpit: (http://\S+)", line):
            return lines, found[1]
    raise SystemExit("\n".join([*lines, "ended without a page"]))


def ride(page: Page) -> None:
    """Click the map and wait until the bicycle rides."""
    expect(page.locator("#mode")).to_have_text("waits for a goal")
    before = page.locator("#position").inner_text()
    box = page.locator("#map").bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + 0.25 * box["height"])
    expect(page.locator("#mode")).to_have_text("riding")
    expect(page.locator("#position")).not_to_have_text(before)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=RESULTS)
    parser.add_argument("--picture", type=Path, help="of the page eight seconds later")
    args = parser.parse_args()
    expect.set_options(timeout=30_000)
    result: dict[str, Any] = {**origin(), "machine": machine()}
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        path = shutil.which("chromium") or shutil.which("chromium-browser")
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        begun = time.monotonic()
        cockpit = start(Path(folder))
        try:
            result["set_up"], address = said(cockpit)
            result["address_after_s"] = round(time.monotonic() - begun, 1)
            page.goto(address)
            ride(page)
            result["rides_after_s"] = round(time.monotonic() - begun, 1)
            if args.picture:
                page.wait_for_timeout(8_000)
                page.screenshot(path=str(args.picture))
            browser.close()
        finally:
            cockpit.send_signal(signal.SIGINT)
            result["exit_status"] = cockpit.wait(30.0)
    result["set_up"] = [line for line in result["set_up"] if "done in" in line]
    args.out.write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
