"""Tests are named after a module, or stand in the table of CONTRIBUTING.md."""

from __future__ import annotations

import re
from pathlib import Path

import test_boundaries

TESTS = Path(__file__).parent
FILES = {path.relative_to(TESTS).as_posix() for path in TESTS.rglob("test_*.py")}
ELSEWHERE = "scripts, set-up, docs, packages"


def table() -> dict[str, list[str]]:
    """Return the files of each room that the page names."""
    page = (TESTS.parent / "CONTRIBUTING.md").read_text()
    section = page.partition("## Find a test")[2].partition("\n## ")[0]
    rows = [line.strip("| ").split(" | ") for line in section.splitlines() if ".py` |" in line]
    return {room.strip("`"): re.findall(r"`([\w/]+\.py)`", files) for room, files in rows}


def test_every_test_can_be_found() -> None:
    modules = {module.rpartition(".")[2] for module in test_boundaries.MODULES}
    named = {name for names in table().values() for name in names}
    lost = {name for name in FILES - named if Path(name).stem.removeprefix("test_") not in modules}
    assert lost == set(), "name it after a module, or in the table"
    assert named - FILES == set()


def test_the_table_names_rooms_of_the_architecture() -> None:
    rooms = {room.name for room in test_boundaries.ROOMS} | {ELSEWHERE}
    assert table().keys() - rooms == set()


PAGES = sorted((TESTS.parent / "docs").rglob("*.md"))


def test_tests_that_a_page_names_exist() -> None:
    files = {Path(name).name for name in FILES}
    functions = {
        name
        for path in TESTS.rglob("test_*.py")
        for name in re.findall(r"^ *(?:async )?def (test_\w+)", path.read_text(), re.MULTILINE)
    }
    lost = []
    for page in PAGES:
        text = page.read_text()
        named = re.findall(r"`(?:[\w/]+/)?(test_\w+\.py)`", text)
        lost += [f"{page.name}: {name}" for name in named if name not in files]
        for name, cut in re.findall(r"`(test_\w+)(…?)`", text):
            if not any(one == name or (cut and one.startswith(name)) for one in functions):
                lost.append(f"{page.name}: {name}")
    assert len(PAGES) > 20
    assert lost == []
