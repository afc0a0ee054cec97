"""Make the pictures of pages in docs/images anew, in Chromium.

    . tests/env.sh
    python tests/tools/docs_pictures.py report RIDE RIDE    # report.png: folders of ride.sh
    python tests/tools/docs_pictures.py cockpit             # cockpit.png: a ride by sensors

The rides of report.png are those that docs/looking.md names.
"""

from __future__ import annotations

import argparse
import io
import subprocess
import tempfile
from pathlib import Path

from chromium import chromium, cockpit, opened
from PIL import Image
from playwright.sync_api import expect

ROOT = Path(__file__).resolve().parents[2]
IMAGES = ROOT / "docs" / "images"
SCRIPTS = ROOT / "ros2_ws"
BY_SENSORS = (
    "simulator.plant:=whipple",
    "simulator.bicycle:=browser-rider",
    "simulator.sensors:=mpu6050-rtk",
    "controller.state:=estimated",
    "controller.sensors:=mpu6050-rtk",
    "controller.policy:=lqr",
)
GOAL = ("40", "12")
RIDDEN = 7_000
"""ms from the goal to the picture: the bicycle is then under way, beyond its turn."""


def keep(shot: bytes, name: str) -> None:
    """Write a picture with 256 colours, which halves its file."""
    image = Image.open(io.BytesIO(shot)).convert("RGB")
    image.quantize(256, dither=Image.Dither.NONE).save(IMAGES / name, optimize=True)
    print(IMAGES / name)


def report(rides: list[Path]) -> None:
    """Draw the top of the report of some rides."""
    with tempfile.TemporaryDirectory() as folder, chromium() as context:
        page = Path(folder) / "report.html"
        words = [str(SCRIPTS / "report.sh"), *map(str, rides), "--output", str(page)]
        subprocess.run(words, check=True)
        tab = context.new_page()
        tab.set_viewport_size({"width": 1180, "height": 1560})
        tab.goto(page.as_uri())
        tab.wait_for_timeout(1_000)
        keep(tab.screenshot(), "report.png")


def ride_by_sensors() -> None:
    """Draw the cockpit during a ride by sensors to one goal."""
    with (
        chromium(main="3d") as context,
        cockpit(*BY_SENSORS) as (address, _, domain),
        opened(context, address) as page,
    ):
        page.set_viewport_size({"width": 1280, "height": 720})
        expect(page.locator("#mode")).to_have_text("waits for a goal")
        words = ["env", f"ROS_DOMAIN_ID={domain}", str(SCRIPTS / "goal.sh"), *GOAL]
        subprocess.run(words, check=True)
        expect(page.locator("#mode")).to_have_text("riding")
        page.wait_for_timeout(RIDDEN)
        keep(page.screenshot(), "cockpit.png")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    kinds = parser.add_subparsers(dest="kind", required=True)
    kinds.add_parser("report").add_argument("rides", nargs="+", type=Path)
    kinds.add_parser("cockpit")
    args = parser.parse_args()
    if args.kind == "report":
        report(args.rides)
    else:
        ride_by_sensors()


if __name__ == "__main__":
    main()
