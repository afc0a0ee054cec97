"""Events of a bag's ride, with the time and the place of each, for the page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bicycle_bag.columns import load
from bicycle_bag.reader import BagReader
from bicycle_cockpit import goal_words
from bicycle_cockpit.hand_over_words import explained
from bicycle_cockpit.riders import rider
from bicycle_cockpit.samples import plain
from bicycle_common import topic_names
from bicycle_controller.control.goals import Status
from bicycle_tools.recorded_here import sent_before
from bicycle_tools.ride_log import PUSHED, RideLog, begun, prefix_of

HAND_OVER = topic_names.in_bag(topic_names.HAND_OVER)
MOST_MARKS = 2_000

Numbers = NDArray[np.float64]
Mark = dict[str, Any]
"""`t` (s), `kind`, `level`, `text`, and the place `x`, `y` (m)."""


class Ridden(NamedTuple):
    """A ride, and the data of its marks."""

    ride: RideLog
    time: Numbers
    """Time of each state, (n,) s."""
    names: Mapping[str, str]
    """Names of policies, by their ids."""


def marks(ridden: Ridden) -> list[Mark]:
    """Return all marks in order of time, the first MOST_MARKS."""
    found = [*_goals(ridden), *_states(ridden), *_others(ridden)]
    return sorted(found, key=lambda mark: float(mark["t"]))[:MOST_MARKS]


def _mark(ridden: Ridden, row: int, kind: str, level: str, text: str) -> Mark:
    """Return the mark of an event at one state."""
    states = ridden.ride.states
    return {
        "t": round(float(ridden.time[row]), 3),
        "kind": kind,
        "level": level,
        "text": text,
        "x": plain(float(states["rear_contact.x"][row])),
        "y": plain(float(states["rear_contact.y"][row])),
    }


def rows_of(ridden: Ridden, messages: Mapping[str, NDArray[Any]]) -> list[int]:
    """Return for each message the newest state recorded before it."""
    places = messages["recorded_order"]
    rows = np.searchsorted(ridden.ride.states["recorded_order"], places, side="right") - 1
    return [int(row) for row in np.maximum(rows, 0)]


def _goals(ridden: Ridden) -> Iterator[Mark]:
    """Yield the goals' outcomes, at the place of the goal, not of the bicycle."""
    found = ridden.ride.statuses
    if "status" not in found:
        return
    news = goal_words.NewsFilter()
    for index, row in enumerate(rows_of(ridden, found)):
        number = int(found["status"][index])
        if number not in set(Status):
            continue  # from a later version
        status = Status(number)
        place = float(found["position.x"][index]), float(found["position.y"][index])
        if not np.isfinite(place).all() or not news.is_new(status, place):
            continue
        text = goal_words.text(status, place, str(found["message"][index]))
        mark = _mark(ridden, row, goal_words.kind(status), goal_words.level(status), text)
        yield {**mark, "x": plain(place[0]), "y": plain(place[1])}


def _states(ridden: Ridden) -> Iterator[Mark]:
    """Yield falls and resets."""
    ride = ridden.ride
    fallen = np.asarray(ride.states["fallen"], dtype=bool)
    for row in np.flatnonzero(fallen & ~np.roll(fallen, 1)):
        yield _mark(ridden, int(row), "fell", "bad", "the bicycle fell")
    for row in np.flatnonzero(np.diff(ride.segment)) + 1:
        episode = int(ride.states["episode"][row])
        yield _mark(ridden, int(row), "reset", "info", f"episode {episode} begins")


def _others(ridden: Ridden) -> Iterator[Mark]:
    """Yield lateral pushes and switches of the controller."""
    reader = BagReader(ridden.ride.path)
    prefix = prefix_of(reader)

    def there(topic: str) -> bool:
        return bool(reader.counts.get(prefix + topic))

    if there(PUSHED):
        pushes = load(reader, prefix + PUSHED)
        rows = rows_of(ridden, pushes)
        for row, rate in zip(rows, pushes["lean_rate"], strict=True):
            text = push_text(float(rate))
            yield {**_mark(ridden, row, "push", "info", text), "lean_rate": float(rate)}
    if there(HAND_OVER):
        changes = load(reader, prefix + HAND_OVER)
        # It is latched: a recorder also gets messages from before it joined.
        before = sent_before(changes, begun(reader), ridden.ride.commands)
        for index, row in enumerate(rows_of(ridden, changes)):
            if before[index]:
                continue
            reason, policy = int(changes["reason"][index]), str(changes["policy"][index])
            name = rider(policy, ridden.names).label
            message = str(changes["message"][index])
            why = explained(reason, message, policy, ridden.names)
            kind = "hand_over" if reason else "hand_back"
            text = f"{name} takes over: {why}" if reason else f"{name} rides again: {why}"
            level = "warn" if reason else "info"
            yield {**_mark(ridden, row, kind, level, text), "why": why}


def push_text(lean_rate: float) -> str:
    """Return a push as text; rad/s, positive to the right."""
    side = "right" if lean_rate > 0 else "left"
    return f"pushed to the {side}, {abs(lean_rate):.2f} rad/s"
