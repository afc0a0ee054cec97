"""Filter messages of a bag that were sent before the recording, or by an idle controller.

A latched (transient local) topic delivers older messages to a recorder that joins in mid-session.
Two controllers that run at once both answer each state, and only one drives.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bicycle_controller.control.goals import Status

Columns = Mapping[str, NDArray[Any]]

SLACK = 0.1
"""Time before a bag's first message at which a message still counts as sent during it (s)."""
OTHER_CLOCK = 1.0
"""Longest time between sending and receiving (s); more means that a clock was set back."""
OPEN = (Status.QUEUED, Status.ACTIVE)
"""Statuses of a goal that is not over."""


def sent_before(columns: Columns, begun: float, commands: Columns) -> NDArray[np.bool_]:
    """Return which messages were sent before a recording began.

    Args:
        columns: (n,) messages of a latched topic, with `log_time` and `publish_time`, s.
        begun: s, log time of the bag's first message in recorded order.
        commands: messages of the same controller that are not latched: they show the difference of
            its clock to the recorder's.

    Returns:
        (n,) bool; all False if the bag does not contain sending times.
    """
    logged = columns["log_time"]
    name = _sending_time(columns, commands)
    if not name:
        return np.zeros(len(logged), dtype=bool)
    delays = commands["log_time"] - commands[name] if len(commands.get(name, ())) else np.zeros(1)
    low, usual, high = np.quantile(delays, (0.1, 0.5, 0.9))
    if high - low > OTHER_CLOCK:
        return np.zeros(len(logged), dtype=bool)
    sent = columns[name] + usual
    # A clock that is set back in mid-ride makes later messages seem older than the bag: those have
    # an earlier time of receipt, too.
    return ((sent < begun - SLACK) & (begun <= logged + SLACK)) | (sent > logged + OTHER_CLOCK)


def _sending_time(columns: Columns, commands: Columns) -> str:
    """Return the column with the sending time; "" without one.

    Recorders before Jazzy write the time of receipt for both times.
    """
    if (columns["publish_time"] != columns["log_time"]).any():
        return "publish_time"
    return "header.stamp" if len(commands.get("header.stamp", ())) else ""


def goals_of_recording(statuses: Columns, begun: float, commands: Columns) -> Columns:
    """Return the goal statuses that belong to a recording.

    Args:
        statuses: columns of GoalStatus.
        begun: s, log time of the bag's first message.
        commands: columns of BicycleCommand.

    Returns:
        The statuses without repetitions and without goals that were over before the recording.
        A goal that was waiting or active then keeps its last status. A column `before` tells
        which rows were sent before the recording.
    """
    if not len(statuses.get("status", ())):
        return statuses
    early = sent_before(statuses, begun, commands)
    keys = list(
        zip(
            statuses["goal_id"].tolist(),
            statuses["position.x"].tolist(),
            statuses["position.y"].tolist(),
            strict=True,
        )
    )
    last_early = {keys[row]: row for row in np.flatnonzero(early).tolist()}
    carried = {row for row in last_early.values() if int(statuses["status"][row]) in OPEN}
    kept = [row for row in _first_sent(statuses) if not early[row] or row in carried]
    return {
        **{name: column[kept] for name, column in statuses.items()},
        "before": early[kept],
    }


def _first_sent(statuses: Columns) -> list[int]:
    """Return the rows without repetitions due to a recorder's new subscription."""
    seen: set[tuple[Any, ...]] = set()
    rows = []
    names = ("publish_time", "goal_id", "status", "position.x", "position.y")
    for row, key in enumerate(zip(*(statuses[name].tolist() for name in names), strict=True)):
        if key not in seen:
            rows.append(row)
        seen.add(key)
    return rows


def driving(commands: Columns, states: Columns) -> NDArray[np.bool_]:
    """Return which commands are those of the controller that drove.

    Args:
        commands: columns of BicycleCommand, (n,).
        states: columns of BicycleState.

    Returns:
        (n,) bool; False for the answer to a state that another controller answered, too, and
        whose successor names that other one. If a state has no successor, the last driver is
        assumed.
    """
    if not len(commands.get("step", ())) or not len(states["step"]):
        return np.ones(len(commands.get("step", ())), dtype=bool)
    names = commands["controller"]
    if len(set(names.tolist())) < 2:
        return np.ones(len(names), dtype=bool)
    drivers = _drivers(states)
    answers = list(zip(commands["episode"].tolist(), commands["step"].tolist(), strict=True))
    given: dict[tuple[int, int], set[str]] = {}
    for answer, name in zip(answers, names.tolist(), strict=True):
        given.setdefault(answer, set()).add(name)
    found = np.ones(len(names), dtype=bool)
    driver: str | None = None
    for row, (answer, name) in enumerate(zip(answers, names.tolist(), strict=True)):
        driver = drivers.get(answer, driver)
        found[row] = driver is None or driver == name or driver not in given[answer]
    return found


def _drivers(states: Columns) -> dict[tuple[int, int], str]:
    """Return for each answered step the controller that the next state names, if any."""
    return {
        (episode, step - 1): name
        for episode, step, name in zip(
            states["episode"].tolist(),
            states["step"].tolist(),
            states["controller"].tolist(),
            strict=True,
        )
        if name
    }
