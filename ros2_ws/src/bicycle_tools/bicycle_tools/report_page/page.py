"""The page itself: one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from datetime import datetime, timezone
from html import escape
from pathlib import Path

from bicycle_tools.report_page import explorer, tables
from bicycle_tools.report_page.drawing_files import DRAWINGS, svg
from bicycle_tools.report_page.loading import RidePage

STYLE = Path(__file__).with_name("style.css")
SECTIONS: tuple[tuple[str, Callable[[RidePage], str]], ...] = (
    ("Goals", tables.goals),
    ("What happened", tables.events),
    ("Who rode, and where", tables.setting),
    ("The bag", tables.contents),
)
KEY = (
    "Green: a goal ended. Red line: a fall; dotted: a reset. Orange band: an older command was "
    "held; red band: no command, the watchdog gave zero input. Angles as in the messages "
    "(REP-103): lean positive to the right, steering and heading error to the left."
)


def title_of(pages: Sequence[RidePage]) -> str:
    """Return the title of the page and the picture."""
    return " and ".join(page.name for page in pages)


def html(pages: Sequence[RidePage], step: Callable[[], object] = lambda: None) -> str:
    """Return the whole page.

    Args:
        pages: one ride, or two to compare.
        step: called after each figure.
    """
    title = escape(title_of(pages))
    parts = [_head(title), *(_ride_line(page) for page in pages)]
    parts += [_section("In numbers", tables.figures(pages))]
    together = explorer.explorer(pages)
    if together:
        parts.append(_section("Rides together" if len(pages) > 1 else "Look into it", together))
    for drawing in DRAWINGS:
        note = f"<p><small>{KEY}</small></p>" if drawing.title == "State" else ""
        # On a phone it is scrolled sideways, which the keyboard must be able to do, too.
        figure = f'<figure tabindex="0" aria-label="{escape(drawing.title)}">'
        still = f"{note}{figure}{svg(drawing, pages)}</figure>"
        if together and drawing.title != "Timing":
            still = f'<details class="still" open><summary>as a picture</summary>{still}</details>'
        parts.append(_section(drawing.title, still))
        step()
    parts += [_section(name, "".join(_columns(pages, make))) for name, make in SECTIONS]
    end = f"</main><script>\n{explorer.script()}</script></body></html>\n"
    return "\n".join([*parts, end])


def _head(title: str) -> str:
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{explorer.policy()}">\n'
        f"<title>Ride report: {title}</title>\n<style>\n{STYLE.read_text(encoding='utf-8')}"
        f"</style></head>\n<body><main>\n<h1>Ride report</h1>"
    )


def _ride_line(page: RidePage) -> str:
    """Return the name, place and time of a bag, its verdict, and its notes."""
    when = ""
    if page.contents.message_count:
        begun = datetime.fromtimestamp(page.start, tz=timezone.utc)
        seconds = 1e-9 * page.contents.duration_ns
        when = f" · recorded {begun:%Y-%m-%d %H:%M:%S} UTC, {seconds:.1f} s"
    notes = "".join(f'<p class="note">{escape(note)}</p>' for note in page.notes)
    return (
        f'<div class="ride"><p><b>{escape(page.name)}</b>{"".join(_chips(page))}</p>'
        f"<p><small>{escape(str(page.path))}{when}</small></p>{notes}</div>"
    )


ENDS = {"finished": True, "active": None, "replaced": None, "cancelled": None, "unknown": None}
"""True for a good end of a path, None for one that is neither; all others are bad."""


def _chips(page: RidePage) -> Iterator[str]:
    """Yield the verdict in a few words."""
    summary = page.summary
    if summary.goals:
        good = summary.reached == summary.decided if summary.decided else None
        yield _chip(f"{summary.reached} of {summary.goals} goals reached", good)
    for path in summary.paths:
        yield _chip(path.verdict, ENDS.get(path.status, False))
    if page.has_states:
        falls = {0: "no fall", 1: "1 fall"}.get(summary.falls, f"{summary.falls} falls")
        yield _chip(falls, summary.falls == 0)
        stops = summary.loop.watchdog_events
        if stops:
            yield _chip(f"watchdog acted {stops} ×", False)
        if summary.loop.lost_steps:
            yield _chip(f"{summary.loop.lost_steps} steps missing", False)


def _chip(text: str, good: bool | None) -> str:
    """Return a short verdict in green or red; in neither for None."""
    kind = {True: " good", False: " bad", None: ""}[good]
    return f' <span class="chip{kind}">{escape(text)}</span>'


def _section(name: str, body: str) -> str:
    return f"<section><h2>{escape(name)}</h2>\n{body}\n</section>"


def _columns(pages: Sequence[RidePage], make: Callable[[RidePage], str]) -> Iterator[str]:
    """Yield the same content for each ride, side by side."""
    if len(pages) == 1:
        yield make(pages[0])
        return
    yield '<div class="columns">'
    for page in pages:
        yield f"<div><h3>{escape(page.name)}</h3>{make(page)}</div>"
    yield "</div>"
