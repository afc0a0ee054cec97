"""Transitions of one bicycle from a bag: built from its steps, or as an older release kept them.

A bag is read without ROS. Up to version 2 of BicycleState the simulator published
`bicycle/transition`; where a bag has it, that is used.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bicycle_common import topic_names
from bicycle_controller.data.transition_builder import (
    Columns,
    Reached,
    TransitionBuilder,
    Transitions,
)
from bicycle_sim.task.scenario import Scenario

if TYPE_CHECKING:
    from bicycle_bag.reader import BagReader

STATE, COMMAND, ECHO, GOAL_STATUS, TRANSITION, EPISODE = (
    topic_names.in_bag(name)
    for name in (
        topic_names.STATE,
        topic_names.COMMAND,
        topic_names.COMMAND_ECHO,
        topic_names.GOAL_STATUS,
        topic_names.TRANSITION,
        topic_names.EPISODE,
    )
)
REACHED = 2
"""Status of a reached goal in GoalStatus."""


@dataclass(frozen=True)
class Extract:
    """Result of one bicycle of one bag."""

    transitions: Transitions
    recorded: bool
    """True if the transitions were in the bag; False if they were built from states."""
    lost: dict[str, int]
    """Number of missing messages, by kind."""


def bicycles(reader: BagReader) -> list[str]:
    """Return the namespaces of the bag's bicycles, such as "" or "/red"."""
    found = {
        name[: -len(topic)]
        for topic in (STATE, TRANSITION)
        for name in reader.topics
        if name.endswith(topic)
    }
    return sorted(found)


def extract(reader: BagReader, prefix: str, scenario: Scenario) -> Extract:
    """Return the transitions of one bicycle.

    Args:
        reader: the bag's reader.
        prefix: the bicycle's namespace, one of `bicycles`.
        scenario: its reward and goal radius are used to build transitions from states.

    Raises:
        bicycle_bag.errors.BagError: if the bag cannot be read or lacks a topic.
    """
    from bicycle_bag.columns import load_topics

    if reader.counts.get(prefix + TRANSITION, 0):
        found, lost = recorded(load_topics(reader, [prefix + TRANSITION])[prefix + TRANSITION])
        return Extract(found, True, lost)
    reader.require([prefix + STATE])
    names = [prefix + topic for topic in (STATE, ECHO, COMMAND, GOAL_STATUS)]
    columns = load_topics(reader, [name for name in names if name in reader.topics])
    states, echoes, commands, statuses = (columns.get(name, {}) for name in names)
    found, lost = built(states, echoes, commands, statuses, scenario)
    return Extract(found, False, lost)


def recorded(columns: Columns) -> tuple[Transitions, dict[str, int]]:
    """Return the transitions that the simulator published; truncate those before a lost one."""
    names = ("observation", "action", "reward", "next_observation", "policy")
    flags = {name: columns[name].astype(bool) for name in ("terminated", "truncated", "fallen")}
    found = Transitions(
        episode=columns["episode"].astype(np.int64),
        step=columns["step"].astype(np.int64),
        **{name: columns[name] for name in names},
        **flags,
        time=columns["log_time"],
    )
    found = found.rows(~_repeats(found.episode, found.step))
    follows = _follows(found.episode, found.step)
    gap = found.step[1:] - found.step[:-1] - 1
    same = (found.episode[1:] == found.episode[:-1]) & (gap > 0)
    lost = int(gap[same & ~found.ended[:-1]].sum())
    return _cut(found, follows), {"transitions": lost}


def built(
    states: Columns, echoes: Columns, commands: Columns, statuses: Columns, scenario: Scenario
) -> tuple[Transitions, dict[str, int]]:
    """Return the transitions built from a bag's messages, and how many messages are missing.

    Args:
        states: columns of BicycleState.
        echoes: columns of CommandEcho; empty without any.
        commands: columns of BicycleCommand; empty without any.
        statuses: columns of GoalStatus; empty without any.
        scenario: its reward and goal radius are used.
    """
    from bicycle_bag.steps import runs, steps

    table = steps(states, echoes, commands)
    table |= {"run": runs(states), "own_heading": _own_heading(states)}
    builder = TransitionBuilder(scenario)
    found = builder.all(table, _reached(statuses))
    return found, {"states": builder.lost, "commands": builder.unknown}


def _own_heading(states: Columns) -> np.ndarray:
    """Return bool (n,): True if a state's heading is not that of the line between its wheels."""
    inner = states.get("plant_state", np.empty((len(states["step"]), 0)))
    if inner.dtype == object:
        own = np.array([len(values) > 0 for values in inner], dtype=bool)
    else:
        own = np.full(len(inner), inner.shape[1] > 0)
    return own | states.get("estimated", np.zeros(len(own))).astype(bool)


def _reached(statuses: Columns) -> set[Reached]:
    """Return the goals that the controller called reached."""
    if not len(statuses.get("status", ())):
        return set()
    rows = np.flatnonzero(statuses["status"] == REACHED)
    numbers, x, y = (
        statuses[name][rows].tolist() for name in ("goal_id", "position.x", "position.y")
    )
    return {(float(number), *place) for number, *place in zip(numbers, x, y, strict=True)}


def _repeats(episode: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return bool (n,): True if a step repeats the one before, as while a bicycle is held."""
    same = np.zeros(len(step), dtype=bool)
    same[1:] = (np.diff(episode) == 0) & (np.diff(step) == 0)
    return same


def _follows(episode: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return bool (n - 1,): True if the next row is the next step."""
    return (np.diff(episode) == 0) & (np.diff(step) == 1)


def _cut(found: Transitions, goes_on: np.ndarray) -> Transitions:
    """Truncate every pursuit whose next step is not the next row; `goes_on` is bool (M - 1,)."""
    last = np.append(~goes_on, True)[: len(found)]
    truncated = found.truncated | (last & ~found.terminated & ~found.fallen)
    return replace(found, truncated=truncated)
