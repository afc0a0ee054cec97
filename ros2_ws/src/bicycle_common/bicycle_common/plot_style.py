"""Common style of all plots: colours of text and lines, and matplotlib's settings."""

from __future__ import annotations

from typing import Any

INK, FAINT, GRID = "#1f2933", "#7b8794", "#e4e7eb"
"""Colours of text and dark lines, of secondary elements, and of grids."""

STYLE: dict[str, Any] = {
    "font.family": "sans-serif",
    "font.size": 9,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": GRID,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
}
"""Settings for `matplotlib.rc_context`."""
