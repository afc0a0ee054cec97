"""axe-core on a page: WCAG 2.2 A and AA, best practice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from chromium import BrowserPage

AXE = (Path(__file__).resolve().parent / "axe" / "axe.min.js").read_text()
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]


def problems(page: BrowserPage, contrast: bool = True) -> list[tuple[str, Any]]:
    """Return the rules that are broken, and where.

    Args:
        page: the opened page.
        contrast: False leaves out the contrast of texts, which takes most of the time.
    """
    page.evaluate(AXE)
    options = {"runOnly": RULES, "rules": {"color-contrast": {"enabled": contrast}}}
    found = page.evaluate("(options) => axe.run(options)", options)
    return [(one["id"], [n["target"] for n in one["nodes"]]) for one in found["violations"]]
