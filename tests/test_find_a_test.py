"""Tests stand in their package's folder, named after a module, or in CONTRIBUTING.md's table."""

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


FOLDERS = {"tools_package": "bicycle_tools"}
"""Folders that are not called like their package: `tests/tools` holds programs, not tests."""


def at_home(name: str) -> bool:
    """Return True if a file `FOLDER/test_MODULE.py` tests a module of the folder's package."""
    folder, _, file = name.rpartition("/")
    module = file.removeprefix("test_").removesuffix(".py")
    packages = {
        full.partition(".")[0]
        for full in test_boundaries.MODULES
        if full.rpartition(".")[2] == module
    }
    return bool(packages) and (
        folder == "ros" or FOLDERS.get(folder, f"bicycle_{folder}") in packages
    )


def test_every_test_can_be_found() -> None:
    named = {name for names in table().values() for name in names}
    lost = {name for name in FILES - named if not at_home(name)}
    assert lost == set(), "put it into its package's folder, named after a module, or in the table"
    assert named - FILES == set()


def test_a_test_in_the_folder_of_another_package_is_lost() -> None:
    assert at_home("common/test_angles.py")
    assert at_home("tools_package/test_summary.py")
    assert at_home("ros/test_controller_node.py")
    assert not at_home("bringup/test_angles.py")
    assert not at_home("ros/test_nothing_of_that_name.py")


def test_the_table_names_rooms_of_the_architecture() -> None:
    rooms = {room.name for room in test_boundaries.ROOMS} | {ELSEWHERE}
    assert table().keys() - rooms == set()


PAGES = sorted((TESTS.parent / "docs").rglob("*.md"))


def test_tests_that_a_page_names_exist() -> None:
    places = FILES | {Path(name).name for name in FILES}
    functions = {
        name
        for path in TESTS.rglob("test_*.py")
        for name in re.findall(r"^ *(?:async )?def (test_\w+)", path.read_text(), re.MULTILINE)
    }
    lost = []
    for page in PAGES:
        text = page.read_text()
        named = re.findall(r"`(?:tests/)?((?:\w+/)*test_\w+\.py)`", text)
        lost += [f"{page.name}: {name}" for name in named if name not in places]
        for name, cut in re.findall(r"`(test_\w+)(…?)`", text):
            if not any(one == name or (cut and one.startswith(name)) for one in functions):
                lost.append(f"{page.name}: {name}")
    assert len(PAGES) > 20
    assert lost == []
