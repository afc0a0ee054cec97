"""The verdict of record_and_learn.sh, on made-up numbers."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from bicycle_tools.record_and_learn import is_better, text_of

RIDE = {"reached": 9, "falls": 1, "ridden_time": 61.25, "path_ratio": 1.125}


def comparison(
    new: tuple[float, float], old: tuple[float, float], rides: tuple[int, int, int]
) -> dict[str, Any]:
    """Return the output of `bicycle evaluate --against` for (reach rate, fall rate) of both.

    The new one does better, as well and worse in so many rides.
    """
    times = {"median_time_s": 20.5, "path_ratio": 1.0625}
    (reach, fall), (old_reach, old_fall) = new, old
    return {
        "controller": "new@0123456789",
        "episodes": 1000,
        "reach_rate": reach,
        "fall_rate": fall,
        **times,
        "against": {
            "controller": "lqr-12345678",
            "reach_rate": old_reach,
            "fall_rate": old_fall,
            **times,
        },
        "comparison": dict(zip(("first_better", "equal", "second_better"), rides, strict=True)),
    }


@pytest.mark.parametrize(
    ("new", "old", "rides", "better"),
    [
        ((0.99, 0.0), (0.98, 0.0), (100, 0, 900), True),
        ((0.98, 0.0), (0.99, 0.0), (900, 0, 100), False),
        ((0.99, 0.01), (0.99, 0.0), (900, 0, 100), False),
        ((1.0, 0.0), (1.0, 0.0), (300, 600, 100), True),
        ((1.0, 0.0), (1.0, 0.0), (100, 800, 100), False),
        ((0.0, 1.0), (0.0, 1.0), (0, 1000, 0), False),
    ],
)
def test_better_is_more_goals_less_falls_then_sooner(
    new: tuple[float, float],
    old: tuple[float, float],
    rides: tuple[int, int, int],
    better: bool,
) -> None:
    assert is_better(comparison(new, old, rides)) is better


def test_the_table_has_before_and_after_in_their_columns(tmp_path: Path) -> None:
    after = {**RIDE, "reached": 10, "falls": 0, "path_ratio": None}
    found = comparison((1.0, 0.0), (0.9, 0.05), (300, 600, 100))
    text = text_of(RIDE, after, found)
    rows = {line[:30].strip(): line[30:].split() for line in text.splitlines()}
    assert rows["goals reached"] == ["9", "10"]
    assert rows["falls"] == ["1", "0"]
    assert rows["path over straight line"] == ["1.125", "-"]
    assert rows["reached"] == ["90.0%", "100.0%"]
    assert rows["fell"] == ["5.0%", "0.0%"]
    assert "better in 300 of them, equal in 600, worse in 100" in text
    assert text.splitlines()[-1] == "the new policy is better"
    for name, data in (("before/summary", RIDE), ("after/summary", after), ("comparison", found)):
        path = tmp_path / f"{name}.json"
        path.parent.mkdir(exist_ok=True)
        path.write_text(json.dumps(data))
    command = [sys.executable, "-m", "bicycle_tools.record_and_learn", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.rstrip("\n")) == (0, text)
