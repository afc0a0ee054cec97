"""Results of paths, arrivals and crossings: how each was made, and what docs/paths.md says."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "paths.md").read_text()
FILES = sorted(
    path
    for folder in ("arrivals", "courses", "crossings")
    for path in (ROOT / "docs" / "results" / folder).glob("*.json")
)


def name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def load(path: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((ROOT / "docs" / "results" / path).read_text())
    return found


@pytest.mark.parametrize("path", FILES, ids=name)
def test_a_result_says_how_a_clean_commit_made_it(path: Path) -> None:
    found = json.loads(path.read_text())
    words = shlex.split(found["command"])
    assert words[:2] == ["bicycle", "evaluate"]
    assert words[words.index("--out") + 1] == name(path)
    assert re.fullmatch(r"[0-9a-f]{40}", found["commit"])
    assert found["processor"]


@pytest.mark.parametrize("path", sorted((ROOT / "docs/results").rglob("*.json")), ids=name)
def test_no_command_names_a_folder_for_temporary_files(path: Path) -> None:
    assert not re.search(r'"command": "[^"\n]*(/tmp|/root|/home)/', path.read_text())


def test_the_page_has_the_numbers_of_random_roads_and_arrivals() -> None:
    cells = []
    for bicycle in ("browser-rider", "choi"):
        (course,) = load(f"courses/random-{bicycle}.json")["courses"]
        assert course["falls"] == 0
        cells.append(f"{course['rms_m']:.3f}, {course['largest_m']:.3f}, no fall")
    assert f"| 1,000 random roads, 3 m/s | {cells[0]} |  | {cells[1]} |" in PAGE
    for bicycle in ("browser-rider", "choi"):
        found = load(f"arrivals/{bicycle}.json")
        assert found["reached"] == found["poses"] == 200
        text = (
            f"(95 % within {found['p95_degrees']:.1f}°, the worst {found['worst_degrees']:.0f}°)"
        )
        assert text in PAGE


@pytest.mark.parametrize("path", [p for p in FILES if p.parent.name == "crossings"], ids=name)
def test_nobody_touches_at_a_crossing_and_the_page_says_how_near_they_came(path: Path) -> None:
    found = json.loads(path.read_text())
    assert (found["crossings"], found["below_1_m"], found["falls"]) == (1000, 0, 0)
    assert found["below_1_m_blind"] > 500
    assert f"[{found['nearest_m']:.2f}](results/crossings/{path.name})" in PAGE
