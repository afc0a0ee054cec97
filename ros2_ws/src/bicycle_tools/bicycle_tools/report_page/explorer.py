"""Rides over each other, to zoom and to point at: the data of the page's one script."""

from __future__ import annotations

import base64
import hashlib
import json
import math
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bicycle_common import json_input
from bicycle_controller.control.goals import Status
from bicycle_tools.report_page.events import ride_events
from bicycle_tools.report_page.loading import RidePage
from bicycle_tools.ride_log import Columns

SCRIPT = Path(__file__).with_name("explorer.js")
MOST_ROWS = 6_000
"""Largest number of rows of a ride on the page; longer ones are thinned evenly."""
MOST_MARKS = 300
STRIPS = (
    ("lean", "°", "lean_angle", 180.0 / math.pi, 2),
    ("steering", "°", "steer_angle", 180.0 / math.pi, 2),
    ("heading error", "°", "heading_error", 180.0 / math.pi, 1),
    ("torque", "N m", "applied.torque", 1.0, 3),
    ("displacement", "cm", "applied.displacement", 100.0, 2),
    ("pedal force", "N", "applied.pedal_force", 1.0, 1),
    ("speed", "m/s", "speed", 1.0, 3),
    ("distance to goal", "m", "goal_distance", 1.0, 2),
)
"""Name, unit, column of `RideLog.states`, factor from SI to the unit, digits."""
DRAWN = {"fall": "fell", "reset": "reset", "watchdog": "no command"}
"""Kinds of `RideEvent` that are marked."""
HELP = (
    "Point at it: the moment is shown in all of it. Drag or ← → (with ⇧) to move in time, wheel "
    "(after a click), pinch or + − to zoom, 0 for all of it, N and P for the next mark, the one "
    "before."
)


def explorer(pages: Sequence[RidePage]) -> str:
    """Return the section's HTML; without script it is empty."""
    rides = [data(page) for page in pages if page.has_states]
    if not rides:
        return ""
    text = json.dumps({"rides": rides, "strips": strips(rides)}, allow_nan=False)
    text = text.replace("<", "\\u003c")  # no name in a bag ends the element
    keys = "".join(
        f'<li class="ride-{number}"><b></b>{escape(ride["name"])}</li>'
        for number, ride in enumerate(rides)
    )
    return (
        f'<div class="explorer" hidden><ul class="keys">{keys}</ul>'
        '<p class="zooms">'
        '<button type="button" data-zoom="in" aria-label="Shorter time">+</button> '
        '<button type="button" data-zoom="out" aria-label="Longer time">−</button> '
        '<button type="button" data-zoom="all">All</button> '
        '<button type="button" data-mark="-1" aria-label="Mark before">◂ mark</button> '
        '<button type="button" data-mark="1" aria-label="Next mark">mark ▸</button></p>'
        '<canvas class="plane" role="img" aria-label="Tracks of the rides"></canvas>'
        '<canvas class="strips" tabindex="0" role="application" '
        f'aria-roledescription="chart" aria-label="{HELP}"></canvas>'
        '<p class="moment" role="status"></p>'
        f"<p><small>{HELP}</small></p></div>"
        "<noscript><p><small>This needs the page's script; the figures below do not."
        "</small></p></noscript>"
        f'<script type="application/json" id="rides">{text}</script>'
    )


def script() -> str:
    """Return the page's script."""
    return SCRIPT.read_text(encoding="utf-8")


def policy() -> str:
    """Return the page's content security policy: this script and nothing from elsewhere."""
    digest = base64.b64encode(hashlib.sha256(f"\n{script()}".encode()).digest()).decode()
    rest = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
    return f"{rest}; script-src 'sha256-{digest}'"


def strips(rides: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return name, unit and digits of each strip for which a ride has values."""
    return [
        {"name": name, "unit": unit, "digits": digits}
        for name, unit, _, _, digits in STRIPS
        if any(name in ride["values"] for ride in rides)
    ]


def data(page: RidePage) -> dict[str, Any]:
    """Return one ride for the script.

    Returns:
        `name`; `t` (s), `x`, `y` (m) and `values` by strip, thinned; `breaks`, rows before which
        no line is drawn; `marks` (`t`, `kind`, `text`, `x`, `y`); `goals` (`x`, `y`, `reached`);
        `radius` of the goals (m).
    """
    log, time = page.log, page.state_time
    stride = -(-len(time) // MOST_ROWS)
    rows = np.arange(0, len(time), stride)
    values = {}
    for name, _, column, factor, digits in STRIPS:
        found = factor * np.asarray(log.states.get(column, ()), dtype=np.float64)
        if len(found) == len(time) and (np.isfinite(found) & (found != 0.0)).any():
            values[name] = _plain(found[rows], digits + 1)
    places = {axis: log.states[f"rear_contact.{axis}"] for axis in "xy"}
    marks = sorted(_marks(page), key=lambda mark: float(mark["t"]))[:MOST_MARKS]
    for mark in marks:
        row = int(np.clip(np.searchsorted(time, mark["t"], side="right") - 1, 0, len(time) - 1))
        if "x" not in mark:
            mark |= {axis: round(float(places[axis][row]), 2) for axis in "xy"}
    return {
        "name": page.name,
        "t": _plain(time[rows], 3),
        **{axis: _plain(np.asarray(places[axis])[rows], 3) for axis in "xy"},
        "values": values,
        "breaks": (np.flatnonzero(np.diff(log.segment[rows])) + 1).tolist(),
        "marks": [mark for mark in marks if all(map(math.isfinite, (mark["x"], mark["y"])))],
        "goals": [
            {
                "x": goal.position[0],
                "y": goal.position[1],
                "reached": goal.status is Status.REACHED,
            }
            for goal in page.outcomes
            if all(map(math.isfinite, goal.position))
        ],
        "radius": _radius(log.episodes),
    }


def _plain(column: NDArray[Any], digits: int) -> list[float | None]:
    numbers = np.round(np.asarray(column, dtype=np.float64), digits).tolist()
    return [value if math.isfinite(value) else None for value in numbers]


def _radius(episodes: Columns) -> float:
    """Return the goals' radius, m; 1 where the bag does not say."""
    for text in episodes.get("scenario", ()):
        try:
            value = float(json_input.parse(str(text)).get("goal_radius", 1.0))
        except (ValueError, TypeError, AttributeError):
            continue
        return value if math.isfinite(value) else 1.0
    return 1.0


def _marks(page: RidePage) -> Iterator[dict[str, Any]]:
    """Yield goals' ends, falls, resets, pushes and hand-overs, not in order."""
    for goal, at in zip(page.outcomes, page.ends_of(page.outcomes), strict=True):
        name = goal.status.name.lower().replace("_", " ")
        x, y = goal.position
        if goal.status not in (Status.QUEUED, Status.ACTIVE) and math.isfinite(x + y):
            kind = "reached" if goal.status is Status.REACHED else "missed"
            text = f"goal ({x:.1f}, {y:.1f}) {name}"
            yield {"t": round(float(at), 3), "kind": kind, "text": text} | {"x": x, "y": y}
    for event in ride_events(page):
        if event.kind in DRAWN:
            yield {"t": round(event.time, 3), "kind": DRAWN[event.kind], "text": event.text}
    pushes, changes = page.log.pushes, page.log.hand_overs
    for at, rate in zip(_times(page, pushes), pushes.get("lean_rate", ()), strict=True):
        side = "right" if rate > 0 else "left"
        text = f"pushed to the {side}, {abs(rate):.2f} rad/s"
        yield {"t": round(float(at), 3), "kind": "push", "text": text}
    texts = zip(changes.get("reason", ()), changes.get("message", ()), strict=True)
    for at, (reason, message) in zip(_times(page, changes), texts, strict=True):
        kind = "hand-over" if reason else "hand-back"
        yield {"t": round(float(at), 3), "kind": kind, "text": f"{kind}: {message}"}


def _times(page: RidePage, columns: Columns) -> NDArray[np.float64]:
    return page.time_of(columns) if len(columns.get("recorded_order", ())) else np.empty(0)
