"""Tables of the page, as HTML; all text from a bag is escaped."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from html import escape

from bicycle_common import json_input
from bicycle_controller.control.goals import Status
from bicycle_tools.outcomes import GoalOutcome
from bicycle_tools.report_page.events import RideEvent, ride_events
from bicycle_tools.report_page.loading import RidePage
from bicycle_tools.text_summary import rows

MOST_ROWS = 500
"""Largest number of rows of a table; its last line counts the rest."""


def table(
    heads: Sequence[str], lines: Iterable[Sequence[str]], numbers: Sequence[int] = ()
) -> str:
    """Return a table.

    Args:
        heads: of the columns.
        lines: cells of the rows, as HTML.
        numbers: right-aligned columns.
    """
    lines = list(lines)
    kinds = ["n" if number in numbers else "t" for number in range(len(heads))]
    head = "".join(_head(text, kind) for text, kind in zip(heads, kinds, strict=True))
    body = "".join(
        "<tr>"
        + "".join(
            f'<td class="{k}" data-head="{escape(h)}">{c}</td>'
            for c, k, h in zip(line, kinds, heads, strict=True)
        )
        + "</tr>\n"
        for line in lines[:MOST_ROWS]
    )
    if len(lines) > MOST_ROWS:
        more = f"and {len(lines) - MOST_ROWS} more"
        body += f'<tr><td colspan="{len(heads)}">{more}</td></tr>\n'
    return (
        f'<div class="wide"><table><thead><tr>{head}</tr></thead>'
        f"<tbody>\n{body}</tbody></table></div>"
    )


def _head(text: str, kind: str) -> str:
    """Return a cell of the head; one without words is no heading."""
    name = "th" if text else "td"
    return f'<{name} class="{kind}">{escape(text)}</{name}>'


def figures(pages: Sequence[RidePage]) -> str:
    """Return the summary's numbers, one column for each ride."""
    found = [
        {name: text for name, text in rows(page.summary) if _is_known(page, name)}
        for page in pages
    ]
    names = list(dict.fromkeys(name for column in found for name in column))
    heads = ["", *(page.name for page in pages)]
    lines = [
        [f"<b>{escape(name)}</b>", *(escape(column.get(name, "–")) for column in found)]
        for name in names
    ]
    return table(heads, lines)


def _is_known(page: RidePage, name: str) -> bool:
    """Return True if the bag contains the data for a row of the summary."""
    if name in ("falls", "time", "path", "peak lean", "watchdog"):
        return page.has_states
    if name == "steps":
        return page.has_states and len(page.log.timing.get("step", ())) > 0
    return True


def goals(page: RidePage) -> str:
    """Return the table of the goals' outcomes."""
    if not page.outcomes:
        return "<p>No goal in this bag.</p>"
    lines = [_goal(number, goal, page) for number, goal in enumerate(page.outcomes, 1)]
    heads = ["", "x, y (m)", "what became of it", "at (s)", "took (s)", "path (m)", "× straight"]
    return table(heads, lines, numbers=(0, 1, 3, 4, 5, 6))


def _goal(number: int, goal: GoalOutcome, page: RidePage) -> list[str]:
    kind = {Status.REACHED: "good", Status.QUEUED: "", Status.ACTIVE: ""}.get(goal.status, "bad")
    name = goal.status.name.lower().replace("_", " ")
    word = f'<span class="{kind}">{name}</span>'
    if kind == "bad" and goal.message:
        word += f" <small>{escape(goal.message)}</small>"
    if goal.begun_before:
        word += " <small>under way when the recording began</small>"
    ratio = goal.path_length / goal.straight if goal.straight > 0 else math.nan
    at = float(page.ends_of([goal])[0])
    ended = kind != ""
    return [
        str(number),
        f"{goal.position[0]:.1f}, {goal.position[1]:.1f}",
        word,
        _number(at, ".1f"),
        _number(goal.elapsed if ended else math.nan, ".1f"),
        _number(goal.path_length if ended else math.nan, ".1f"),
        _number(ratio if goal.status is Status.REACHED else math.nan, ".2f"),
    ]


def _number(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else "–"


def events(page: RidePage) -> str:
    """Return the table of events, in order."""
    found = ride_events(page)
    if not found:
        return "<p>Nothing: no reset, no fall, no missing command.</p>"
    return table(["at (s)", "", "what happened"], map(_event, found), numbers=(0,))


def _event(one: RideEvent) -> list[str]:
    kind = "bad" if one.kind in ("fall", "watchdog", "rejected", "gap") else ""
    return [f"{one.time:.2f}", f'<span class="{kind}">{one.kind}</span>', escape(one.text)]


def setting(page: RidePage) -> str:
    """Return the setting of the ride: policies, scenario, physics, seeds, and the bag's origin."""
    lines = [*_policies(page), *_episodes(page)]
    lines += sorted(page.contents.custom_data.items())
    return table(["", ""], ([f"<b>{escape(name)}</b>", escape(text)] for name, text in lines))


def _policies(page: RidePage) -> list[tuple[str, str]]:
    ridden = Counter(str(name) for name in page.log.commands.get("policy", ()))
    total = sum(ridden.values())
    return [
        ("policy", f"{name or 'without an id'}: {count} of {total} commands")
        for name, count in ridden.most_common()
    ]


def _episodes(page: RidePage) -> list[tuple[str, str]]:
    episodes = page.log.episodes
    if not len(episodes.get("episode", ())):
        return []
    numbers = [int(number) for number in episodes["episode"]]
    lines = [("episodes", f"{len(numbers)}, from {min(numbers)} to {max(numbers)}")]
    names = {"pace": "pace", "seed": "seed", "version": "bicycle_sim", "scenario": "scenario"}
    for column, name in names.items():
        texts = dict.fromkeys(_plain(str(text)) for text in episodes.get(column, ()))
        shown = list(texts)[:5] + (["…"] if len(texts) > 5 else [])
        lines.append((name, ", ".join(shown)))
    physics = dict.fromkeys(str(text) for text in episodes.get("physics", ()))
    return [*lines, *(("physics", _switches(text)) for text in physics)]


def _plain(text: str) -> str:
    """Return the name in a JSON object; other texts unchanged."""
    try:
        value = json_input.parse(text)
    except ValueError:
        return text
    return str(value.get("name", text)) if isinstance(value, dict) else text


def _switches(text: str) -> str:
    """Return the physics without its constants, which are those of Table 1."""
    try:
        value = json_input.parse(text)
    except ValueError:
        return text
    if not isinstance(value, dict):
        return text
    return ", ".join(f"{name} {on}" for name, on in value.items() if name != "constants")


def _breakable(name: str) -> str:
    """Return a name as HTML that may break after a slash."""
    return escape(name).replace("/", "/<wbr>")


def contents(page: RidePage) -> str:
    """Return the table of the bag's topics."""
    seconds = 1e-9 * page.contents.duration_ns
    counts = page.contents.counts
    lines = [
        [
            _breakable(topic.name),
            _breakable(topic.type),
            f"{counts.get(topic.name, 0):,}",
            _number(counts.get(topic.name, 0) / seconds if seconds else math.nan, ".1f"),
        ]
        for topic in sorted(page.contents.topics, key=lambda topic: topic.name)
    ]
    return table(["topic", "type", "messages", "per second"], lines, numbers=(2, 3))
