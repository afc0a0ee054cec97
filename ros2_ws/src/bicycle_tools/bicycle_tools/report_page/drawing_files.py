"""Figures as text of SVG that follows the page's light or dark colours, and as one PNG."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
from matplotlib.figure import Figure

from bicycle_common import plot_style
from bicycle_tools import drawing
from bicycle_tools.report_page.figures import Canvas, draw_commands, draw_states, draw_tracks
from bicycle_tools.report_page.loading import RidePage
from bicycle_tools.report_page.timing import draw_timing

THEMED = {
    "ink": plot_style.INK,
    "faint": plot_style.FAINT,
    "grid": plot_style.GRID,
    "reached": drawing.REACHED,
    "failed": drawing.FAILED,
    "lean": drawing.LEAN,
    "steer": drawing.STEER,
    "torque": drawing.TORQUE,
    "shift": drawing.SHIFT,
}
"""Colours for which the page's style sheet has a variable, by its name."""
DPI = 130


class Drawing(NamedTuple):
    """One figure of the page: its heading, its function, its inches for one ride and for two."""

    title: str
    draw: Callable[[Canvas, Sequence[RidePage]], None]
    heights: tuple[float, float]

    def size(self, pages: Sequence[RidePage]) -> tuple[float, float]:
        """Return width and height in inches."""
        return (10.0, self.heights[0]) if len(pages) == 1 else (14.0, self.heights[1])


DRAWINGS = (
    Drawing("Track", draw_tracks, (7.0, 6.0)),
    Drawing("State", draw_states, (8.6, 8.6)),
    Drawing("Commands", draw_commands, (4.0, 4.0)),
    Drawing("Timing", draw_timing, (5.2, 5.2)),
)


def svg(item: Drawing, pages: Sequence[RidePage]) -> str:
    """Return one figure as an `<svg>` element with nothing outside it."""
    text = StringIO()
    with mpl.rc_context({**drawing.STYLE, "svg.fonttype": "none", "svg.hashsalt": "bicycle"}):
        figure = Figure(figsize=item.size(pages), layout="constrained")
        item.draw(figure, pages)
        figure.savefig(text, format="svg", transparent=True)
    return _themed(text.getvalue(), item.title)


def _themed(text: str, title: str) -> str:
    body = text[text.index("<svg") :]
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    body = re.sub(r'<g id="[^"]*">', "<g>", body)
    body = re.sub(r'width="[\d.]+pt" height="[\d.]+pt"', 'role="img"', body, count=1)
    body = body.replace(">", f"><title>{title}</title>", 1)
    # matplotlib gives clip paths and glyphs the same names in every figure of equal size.
    prefix = title.lower()
    body = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{prefix}-", body)
    for name, colour in THEMED.items():
        body = body.replace(colour, f"var(--{name})")
    return body


def png(path: Path, title: str, pages: Sequence[RidePage]) -> None:
    """Write all figures below each other.

    Args:
        path: file to write.
        title: above them.
        pages: one ride, or two.
    """
    sizes = [item.size(pages) for item in DRAWINGS]
    heights = [height for _, height in sizes]
    with mpl.rc_context(drawing.STYLE):
        figure = Figure(figsize=(sizes[0][0], sum(heights) + 0.6), layout="constrained")
        figure.suptitle(title, fontsize=13, fontweight="bold")
        parts = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
        for part, item in zip(parts, DRAWINGS, strict=True):
            item.draw(part, pages)
        figure.savefig(path, format="png", dpi=DPI)
