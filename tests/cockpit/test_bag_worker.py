"""Answers of the process that reads bags."""

from __future__ import annotations

import io
import json
import shutil
from pathlib import Path

import pytest
from made_bag import write_bag

from bicycle_cockpit import shelf
from bicycle_cockpit.bag_worker import Worker


def listed(folder: Path) -> list[dict[str, object]]:
    """Return the entries of a list."""
    out = io.BytesIO()
    Worker(folder, out).answer({"do": "list", "skip": []})
    answers = [json.loads(line) for line in out.getvalue().splitlines()]
    assert answers[-1] == {"done": True}
    return [answer["entry"] for answer in answers if "entry" in answer]


def test_bags_that_are_too_many_for_the_list_are_counted_at_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shelf, "MOST_BAGS", 2)
    bag = write_bag(tmp_path / "a")
    shutil.copytree(bag, tmp_path / "b")
    assert len(listed(tmp_path)) == 2
    for name in ("c", "d", "e"):
        shutil.copytree(bag, tmp_path / name)
    *shown, last = listed(tmp_path)
    assert len(shown) == 2
    assert last == {
        "name": "3 older bags",
        "problem": "not listed: only the newest 2 are; --bags takes another folder",
    }
