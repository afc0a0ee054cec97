"""Events of a ride, in order: resets, falls, missing commands, new policies."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bicycle_controller.control.goals import Status
from bicycle_tools.report_page.loading import RidePage
from bicycle_tools.ride_log import Columns
from bicycle_tools.summary import HELD, ZERO


class RideEvent(NamedTuple):
    """One event of a ride.

    Attributes:
        time: s, on the page's axis.
        kind: reset, fall, watchdog, held, gap, policy, controller or rejected.
        text: one line for a person.
        until: end of the event, s; equal to `time` if it has no duration.
    """

    time: float
    kind: str
    text: str
    until: float


def ride_events(page: RidePage) -> list[RideEvent]:
    """Return all events, in order of time."""
    found = [*_from_states(page), *_from_commands(page), *_rejections(page)]
    return sorted(found, key=lambda one: one.time)


def _from_states(page: RidePage) -> Iterator[RideEvent]:
    states, segment, time = page.log.states, page.log.segment, page.state_time
    if not page.has_states:
        return
    for first, _ in runs(states["fallen"].astype(bool), segment):
        lean = np.degrees(states["lean_angle"][first])
        at = f"({states['rear_contact.x'][first]:.1f}, {states['rear_contact.y'][first]:.1f})"
        text = f"fell at {at}, lean {lean:.1f}°, {states['speed'][first]:.2f} m/s"
        yield RideEvent(float(time[first]), "fall", text, float(time[first]))
    for row in np.flatnonzero(np.diff(segment)) + 1:
        episode = int(states["episode"][row])
        again = episode <= int(states["episode"][row - 1])
        text = "the simulator was started anew" if again else f"reset: episode {episode} begins"
        yield RideEvent(float(time[row]), "reset", text, float(time[row]))
    kinds = ((ZERO, "watchdog", "no command: zero input"), (HELD, "held", "held an older command"))
    for source, kind, what in kinds:
        for first, last in runs(states["command_source"] == source, segment):
            text = f"{what} for {_steps(last - first + 1)}"
            yield RideEvent(float(time[first]), kind, text, float(time[last]))
    missing = np.diff(states["step"].astype(np.int64)) - 1
    for row in np.flatnonzero((missing > 0) & (np.diff(segment) == 0)):
        text = f"{_steps(int(missing[row]))} missing in the bag"
        yield RideEvent(float(time[row]), "gap", text, float(time[row + 1]))


def _steps(count: int) -> str:
    return "1 step" if count == 1 else f"{count} steps"


def runs(flag: NDArray[np.bool_], segment: NDArray[np.intp]) -> list[tuple[int, int]]:
    """Return the first and last rows of the stretches within one segment where a flag is True."""
    broken = np.diff(segment, prepend=-1) != 0
    begins = flag & (broken | ~np.concatenate([[False], flag[:-1]]))
    ends = flag & np.concatenate([broken[1:] | ~flag[1:], [True]])
    return list(zip(np.flatnonzero(begins).tolist(), np.flatnonzero(ends).tolist(), strict=True))


def _from_commands(page: RidePage) -> Iterator[RideEvent]:
    commands, time = page.log.commands, page.step_time(page.log.commands)
    for column, kind, what in (
        ("policy", "policy", "policy {} rides"),
        ("controller", "controller", "controller {} gives the commands"),
    ):
        for row in _changes(commands, column):
            when = float(time[row])
            yield RideEvent(
                when, kind, what.format(commands[column][row] or "without a name"), when
            )


def _changes(columns: Columns, name: str) -> list[int]:
    """Return the rows in which a text differs from the one before, including the first row."""
    values: NDArray[Any] = columns.get(name, np.empty(0, dtype=object))
    if not len(values):
        return []
    return [0, *(np.flatnonzero(values[1:] != values[:-1]) + 1).tolist()]


def _rejections(page: RidePage) -> Iterator[RideEvent]:
    statuses = page.log.statuses
    for row in np.flatnonzero(statuses.get("status", np.empty(0)) == Status.REJECTED):
        when = float(page.time_of({name: column[[row]] for name, column in statuses.items()})[0])
        text = f"a goal was rejected: {statuses['message'][row]}"
        yield RideEvent(when, "rejected", text, when)
