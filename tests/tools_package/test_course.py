"""Random goals and files of waypoints."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from bicycle_tools.course import random_goals, read_waypoints


def test_goals_lie_in_the_field_and_apart() -> None:
    start = (5.0, -3.0)
    goals = random_goals(200, 60.0, start, np.random.default_rng(1), nearest=10.0)
    assert len(goals) == 200
    assert max(max(abs(x - 5.0), abs(y + 3.0)) for x, y in goals) <= 30.0
    hops = [math.dist(a, b) for a, b in zip([start, *goals], goals, strict=False)]
    assert min(hops) >= 10.0
    assert max(hops) > 50.0


def test_a_seed_fixes_the_goals() -> None:
    first, again, other = (
        random_goals(5, 60.0, (0.0, 0.0), np.random.default_rng(seed)) for seed in (7, 7, 8)
    )
    assert first == again != other


@pytest.mark.parametrize(("count", "field"), [(0, 60.0), (3, 19.0), (3, math.nan), (3, math.inf)])
def test_impossible_fields_are_refused(count: int, field: float) -> None:
    with pytest.raises(ValueError, match=r"goal|field"):
        random_goals(count, field, (0.0, 0.0), np.random.default_rng(0))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("w.csv", "x,y\n1,2\n\n# a comment\n-3.5, 4e0\n"),
        ("w.csv", "1,2\n-3.5,4\n"),
        ("w.yaml", "[[1, 2], [-3.5, 4]]"),
        ("w.yml", "waypoints:\n- {x: 1, y: 2}\n- {x: -3.5, y: 4}\n"),
    ],
)
def test_all_forms_of_waypoints_are_read(tmp_path: Path, name: str, text: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    assert read_waypoints(path) == [(1.0, 2.0), (-3.5, 4.0)]


@pytest.mark.parametrize(
    ("name", "text", "complaint"),
    [
        ("w.txt", "1,2", "neither .yaml nor .csv"),
        ("w.csv", "", "holds no waypoint"),
        ("w.csv", "1,2\n3\n", "line 2: .* is not a point"),
        ("w.csv", "1,2\nx,4\n", "line 2: .* is not a point"),
        ("w.csv", "1,nan\n", "line 1: .* is not finite"),
        ("w.yaml", "goals: [[1, 2]]", "must be a list"),
        ("w.yaml", "[[1, 2], {x: 1}]", "waypoint 2: .* is not a point"),
        ("w.yaml", "[1, 2]", "waypoint 1: 1 is not a point"),
        ("w.yaml", "a: [", "is not YAML"),
    ],
)
def test_bad_waypoints_are_named(tmp_path: Path, name: str, text: str, complaint: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(ValueError, match=complaint) as caught:
        read_waypoints(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"cannot read .*No such file"):
        read_waypoints(tmp_path / "none.csv")
