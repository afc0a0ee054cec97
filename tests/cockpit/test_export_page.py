"""Recorded rides as a page for any web server."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from made_bag import write_bag

from bicycle_bag.errors import BagError
from bicycle_cockpit.bags import session
from bicycle_cockpit.export_page import export_page
from bicycle_cockpit.server import WEB


def test_the_folder_holds_the_page_and_the_rides_as_the_cockpit_sends_them(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "first")
    index = export_page([bag, bag], tmp_path / "page")
    assert '<meta name="rides" content="rides">' in index.read_text()
    files = {path.relative_to(WEB).as_posix() for path in WEB.rglob("*") if path.is_file()}
    written = tmp_path / "page" / "web"
    assert {p.relative_to(written).as_posix() for p in written.rglob("*") if p.is_file()} == files
    listed = json.loads((tmp_path / "page" / "rides" / "index.json").read_text())["bags"]
    assert [one["name"] for one in listed] == ["first", "first2"]
    ride = json.loads((tmp_path / "page" / "rides" / "first2.json").read_text())
    expected = json.loads(json.dumps(session(bag)))
    assert {key: ride[key] for key in expected} == expected
    assert {one["colour"] for one in ride["slots"]} == {one["colour"] for one in ride["riders"]}


def test_a_bag_that_cannot_be_read_leaves_no_page(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(BagError):
        export_page([tmp_path / "empty"], tmp_path / "page")
    assert not (tmp_path / "page" / "index.html").exists()
