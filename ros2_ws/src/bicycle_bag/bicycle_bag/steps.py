"""States of a bag of any release, each with the command that led to it.

Up to version 2 of BicycleState a state named the command's source, step, sender and goal; since
then they are in CommandEcho. What reads a ride takes the table that `steps` makes of either.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bicycle_bag.columns import Columns
from bicycle_bag.reader import BagReader
from bicycle_common.geometry import heading_error, yaw_to_heading
from bicycle_common.types import CommandSource

COMMAND_FIELDS = {
    "torque": np.nan,
    "displacement": np.nan,
    "pedal_force": np.nan,
    "has_goal": False,
    "goal_id": 0,
    "goal.x": np.nan,
    "goal.y": np.nan,
    "policy": "",
    "controller": "",
}
"""Fields of a command in the table, and their values where none is known."""
DRIVEN = (CommandSource.FRESH, CommandSource.HELD)


def steps(states: Columns, echoes: Columns, commands: Columns) -> Columns:
    """Return the columns of states with what led to each.

    Args:
        states: BicycleState, (n,).
        echoes: CommandEcho; empty in a bag that has none.
        commands: BicycleCommand; empty in a bag that has none.

    Returns:
        The columns of `states` and, (n,) each: `command_source`, `command_step` (-1 for none),
        `controller`, `has_goal`, `goal.x`, `goal.y` (m, NaN without a goal), `heading_error` (rad,
        positive to the left), `goal_distance` (m); and `applied.` with each of COMMAND_FIELDS and
        `applied.known`, which is False where the command was not recorded. Where a bag has no
        echoes, the answer to the state before is taken for the command that was applied.
    """
    if "command_source" in states:
        rows = _applied(states, commands)
        columns = {**states, **_taken(commands, rows)}
    elif len(echoes.get("step", ())):
        columns = _from_echoes(states, echoes)
    else:
        columns = _guessed(states, commands)
    return columns if "goal_distance" in columns else {**columns, **_bearing(columns)}


def states_name_commands(reader: BagReader, topic: str) -> bool:
    """Return True if a bag's states are of version 2 or less, which name the applied command."""
    return topic in reader.topics and "command_source" in reader.definition(topic)


def runs(table: Columns) -> NDArray[np.int64]:
    """Return (n,) the index of each row's simulator process: a new one counts from 1 again."""
    episode, step = (table[name].astype(np.int64) for name in ("episode", "step"))
    back = (np.diff(episode) < 0) | ((np.diff(episode) == 0) & (np.diff(step) < 0))
    return np.concatenate([[0], np.cumsum(back)]) if len(step) else np.zeros(0, dtype=np.int64)


def _from_echoes(states: Columns, echoes: Columns) -> Columns:
    """Return the table of a bag that has echoes."""
    ours = (runs(states), states["episode"], states["step"])
    theirs = (runs(echoes), echoes["episode"], echoes["step"])
    rows = _match(ours, theirs)
    known = rows >= 0
    source = np.where(known, echoes["command_source"][rows], CommandSource.INITIAL)
    driven = known & np.isin(source, DRIVEN)
    fields = {name: echoes[f"command.{name}"] for name in COMMAND_FIELDS}
    found = _taken(fields, np.where(driven, rows, -1))
    return {
        **states,
        **found,
        "command_source": source.astype(np.uint8),
        "command_step": np.where(driven, echoes["command.step"][rows].astype(np.int64), -1),
        **_named(found),
    }


def _guessed(states: Columns, commands: Columns) -> Columns:
    """Return the table of a bag without echoes: each answer led to the next state."""
    step = states["step"].astype(np.int64)
    rows = np.full(len(step), -1)
    if len(commands.get("step", ())):
        order = commands["recorded_order"]
        starts = states["recorded_order"][np.flatnonzero(np.diff(runs(states))) + 1]
        theirs = (
            np.searchsorted(starts, order, "right"),
            commands["episode"],
            commands["step"].astype(np.int64),
        )
        rows = _match((runs(states), states["episode"], step - 1), theirs)
    found = _taken(commands, rows)
    source = np.where(rows >= 0, CommandSource.FRESH, CommandSource.INITIAL)
    return {
        **states,
        **found,
        "command_source": source.astype(np.uint8),
        "command_step": np.where(rows >= 0, step - 1, -1),
        **_named(found),
    }


def _applied(states: Columns, commands: Columns) -> NDArray[np.intp]:
    """Return for each state (n,) that names its command the row of it, -1 without one."""
    driven = np.isin(states["command_source"], DRIVEN)
    if not len(commands.get("step", ())):
        return np.full(len(driven), -1)
    run = runs(states)
    starts = states["recorded_order"][np.flatnonzero(np.diff(run)) + 1]
    names = np.concatenate([states["controller"], commands["controller"]]).astype(str)
    _, who = np.unique(names, return_inverse=True)
    ours = (run, states["episode"], states["command_step"], who[: len(run)])
    theirs = (
        np.searchsorted(starts, commands["recorded_order"], "right"),
        commands["episode"],
        commands["step"].astype(np.int64),
        who[len(run) :],
    )
    action = np.stack([commands[n] for n in ("torque", "displacement", "pedal_force")], axis=1)
    rows = _match(ours, theirs, np.isfinite(action).all(axis=1))
    return np.where(driven, rows, -1)


def _match(
    ours: tuple[NDArray[np.generic], ...],
    theirs: tuple[NDArray[np.generic], ...],
    fit: NDArray[np.bool_] | None = None,
) -> NDArray[np.intp]:
    """Return for each row of `ours` the first equal row of `theirs` that is fit; -1 for none."""
    count = len(ours[0])
    key = np.zeros(count + len(theirs[0]), dtype=np.int64)
    for one, other in zip(ours, theirs, strict=True):
        both = np.concatenate([one.astype(np.int64), other.astype(np.int64)])
        values, code = np.unique(both, return_inverse=True)
        key = key * len(values) + code
    wanted, there = key[:count], key[count:]
    order = np.argsort(there, kind="stable")
    if fit is not None:
        order = order[fit[order]]
    if not len(order):
        return np.full(count, -1)
    place = np.minimum(np.searchsorted(there[order], wanted), len(order) - 1)
    found: NDArray[np.intp] = np.where(there[order][place] == wanted, order[place], -1)
    return found


def _taken(commands: Columns, rows: NDArray[np.intp]) -> Columns:
    """Return the fields of the commands at `rows` (n,), -1 for none, as `applied.` columns."""
    known = rows >= 0
    found: Columns = {"applied.known": known}
    for name, nothing in COMMAND_FIELDS.items():
        kind = object if isinstance(nothing, str) else np.asarray(nothing).dtype
        column = np.full(len(rows), nothing, dtype=kind)
        if known.any():
            column[known] = commands[name][rows[known]]
        found[f"applied.{name}"] = column
    return found


def _named(found: Columns) -> Columns:
    """Return the columns that states up to version 2 had of the command, but for its step."""
    has_goal = found["applied.has_goal"].astype(bool)
    return {
        "controller": found["applied.controller"],
        "has_goal": has_goal,
        "goal.x": np.where(has_goal, found["applied.goal.x"], np.nan),
        "goal.y": np.where(has_goal, found["applied.goal.y"], np.nan),
    }


def _bearing(table: Columns) -> Columns:
    """Return heading error (rad, positive to the left) and distance (m) of each row's goal."""
    x, y = table["rear_contact.x"], table["rear_contact.y"]
    goal = table["goal.x"], table["goal.y"]
    error = heading_error(yaw_to_heading(table["heading"]), x, y, *goal)
    return {
        "heading_error": -np.asarray(error),
        "goal_distance": np.hypot(goal[0] - x, goal[1] - y),
    }
