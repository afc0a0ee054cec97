"""The page's files: code of others is what it is said to be, and everything is delivered."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from bicycle_cockpit.server import WEB
from bicycle_sim.task import render

VENDOR = WEB / "vendor"
SETUP = Path(__file__).resolve().parents[2] / "ros2_ws" / "src" / "bicycle_cockpit" / "setup.py"


def test_code_of_others_is_unchanged_and_comes_with_its_licence() -> None:
    rows = re.findall(
        r"\| `(\S+\.js)` \|.*`(\S+\.LICENSE)` \| `(\w+)` \|", (VENDOR / "README.md").read_text()
    )
    assert {name for name, _, _ in rows} == {path.name for path in VENDOR.glob("*.js")}
    for name, licence, digest in rows:
        assert hashlib.sha256((VENDOR / name).read_bytes()).hexdigest() == digest
        assert "MIT License" in (VENDOR / licence).read_text()


def test_every_import_of_the_page_is_one_of_its_files() -> None:
    for path in WEB.rglob("*.js"):
        if path.parent == VENDOR:
            continue
        for target in re.findall(r"""(?:from|import\()\s*"(\.[^"]+)\"""", path.read_text()):
            assert (path.parent / target).resolve().is_file(), f"{path.name} imports {target}"


def test_the_page_asks_for_all_of_its_modules_at_once() -> None:
    head = (WEB / "index.html").read_text().partition("<body>")[0]
    asked = re.findall(r'<link rel="modulepreload" href="web/([^"]+)">', head)
    modules = {path.relative_to(WEB).as_posix() for path in WEB.rglob("*.js")}
    assert sorted(asked) == sorted(modules - {"main.js"})


def test_every_folder_of_the_page_is_delivered() -> None:
    delivered = set(re.findall(r'"(web(?:/\w+)?)/\*"', SETUP.read_text()))
    folders = {path.parent.relative_to(WEB.parent).as_posix() for path in WEB.rglob("*.*")}
    assert folders == delivered


def test_gymnasiums_picture_has_the_colours_of_the_page() -> None:
    style = (WEB / "style.css").read_text().partition("@media")[0]
    page = dict(re.findall(r"--(\w+): (#\w+)", style))
    bicycle = (WEB / "scene" / "bicycle.js").read_text()
    assert (page["skycolour"], page["ground"]) == (render.SKY, render.GROUND)
    assert (page["groundline"], page["groundedge"]) == (render.GRID, render.EDGE)
    assert (page["good"], page["ink"]) == (render.GOAL, render.INK)
    parts = ("FRAME", "METAL", "TYRE", "RIM", "JERSEY", "SHORTS", "SKIN", "SHOE", "HELMET")
    for part in parts:
        assert f'{part.lower()}: make("{getattr(render, part)}"' in bicycle, part
