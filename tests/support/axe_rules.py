"""axe-core on a page: WCAG 2.2 A and AA, best practice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from chromium import BrowserPage

AXE = (Path(__file__).resolve().parent / "axe" / "axe.min.js").read_text()
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]


def problems(page: BrowserPage) -> list[tuple[str, Any]]:
    """Return the rules that are broken, and where."""
    page.evaluate(AXE)
    found = page.evaluate("(rules) => axe.run({ runOnly: rules })", RULES)
    return [(one["id"], [n["target"] for n in one["nodes"]]) for one in found["violations"]]
