"""The page of interfaces is what the code says."""

from __future__ import annotations

from pathlib import Path

from bicycle_common.nodes.interfaces import page

PAGE = Path(__file__).parents[2] / "docs" / "interfaces.md"


def test_the_page_is_the_code_s() -> None:
    remedy = "make it again: python -m bicycle_common.nodes.interfaces > docs/interfaces.md"
    assert PAGE.read_text() == page(), remedy
