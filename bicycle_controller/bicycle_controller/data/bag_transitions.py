"""Transitions of one bicycle from a bag: as recorded, or rebuilt from its states.

A bag is read without ROS. If it has `bicycle/transition`, that is used; if not, each step is
built from the state before it, the state after it and the command that the later state names as
applied, by the rules of `bicycle_sim.runtime.transitions`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from bicycle_common import topic_names
from bicycle_common.conventions import mirror
from bicycle_common.geometry import heading_between, heading_error, yaw_to_heading
from bicycle_common.observation import OBSERVATION_FIELDS
from bicycle_common.types import CommandSource
from bicycle_sim.task.reward import reward_terms
from bicycle_sim.task.scenario import Scenario

if TYPE_CHECKING:
    from bicycle_bag.reader import BagReader

STATE, COMMAND, TRANSITION, EPISODE = (
    topic_names.in_bag(name)
    for name in (
        topic_names.STATE,
        topic_names.COMMAND,
        topic_names.TRANSITION,
        topic_names.EPISODE,
    )
)

Columns = dict[str, np.ndarray]
"""One array per field of a message, one row per message, in recorded order."""


@dataclass(frozen=True)
class Transitions:
    """M steps towards goals in the paper's signs, one pursuit after another.

    The last step of every pursuit is terminated, truncated or fallen, so that no sum along it
    continues into the next one.
    """

    episode: np.ndarray
    """(M,)."""
    step: np.ndarray
    """(M,), of the state in which the action was taken."""
    observation: np.ndarray
    """(M, 6) SI units, see OBSERVATION_FIELDS."""
    action: np.ndarray
    """(M, 3) N m, m, N, see ACTION_FIELDS."""
    reward: np.ndarray
    """(M,), equation 20."""
    next_observation: np.ndarray
    """(M, 6)."""
    terminated: np.ndarray
    """bool (M,): True if the goal was reached."""
    truncated: np.ndarray
    """bool (M,): True if the pursuit was cut: reset, new goal, no command, or a lost message."""
    fallen: np.ndarray
    """bool (M,): True if the bicycle has fallen in the next state."""
    policy: np.ndarray
    """(M,) ids of the policies that chose the actions."""
    time: np.ndarray
    """(M,) s, time of the recording."""

    def __len__(self) -> int:
        return len(self.step)

    @property
    def ended(self) -> np.ndarray:
        """bool (M,): True for the last step of a pursuit."""
        return self.terminated | self.truncated | self.fallen

    @classmethod
    def join(cls, parts: list[Transitions]) -> Transitions:
        """Concatenate several parts."""
        names = [item.name for item in fields(cls)]
        return cls(**{n: np.concatenate([getattr(part, n) for part in parts]) for n in names})


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
        reader: of the bag.
        prefix: the bicycle's namespace, one of `bicycles`.
        scenario: its reward and goal radius are used to build transitions from states.

    Raises:
        bicycle_bag.errors.BagError: if the bag cannot be read or lacks a topic.
    """
    from bicycle_bag.columns import load_topics

    if reader.counts.get(prefix + TRANSITION, 0):
        found, lost = recorded(load_topics(reader, [prefix + TRANSITION])[prefix + TRANSITION])
        return Extract(found, True, lost)
    columns = load_topics(reader, [prefix + STATE, prefix + COMMAND])
    found, lost = rebuilt(columns[prefix + STATE], columns[prefix + COMMAND], scenario)
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
    found = _rows(found, ~_repeats(found.episode, found.step))
    follows = _follows(found.episode, found.step)
    gap = found.step[1:] - found.step[:-1] - 1
    same = (found.episode[1:] == found.episode[:-1]) & (gap > 0)
    lost = int(gap[same & ~found.ended[:-1]].sum())
    return _cut(found, follows), {"transitions": lost}


def rebuilt(
    states: Columns, commands: Columns, scenario: Scenario
) -> tuple[Transitions, dict[str, int]]:
    """Return the transitions built from states and the commands that they name."""
    run = _runs(states)
    episode, step = (states[name].astype(np.int64) for name in ("episode", "step"))
    keep = ~_repeats(episode, step)
    states, run = {name: column[keep] for name, column in states.items()}, run[keep]
    episode, step = episode[keep], step[keep]
    follows = _follows(episode, step) & (run[1:] == run[:-1])
    gap = np.diff(step)[(np.diff(episode) == 0) & (np.diff(run) == 0)] - 1
    before = np.flatnonzero(follows)
    source = states["command_source"][before + 1]
    driven = (source == CommandSource.FRESH) | (source == CommandSource.HELD)
    row = _applied(states, run, before + 1, commands)
    lost = {"states": int(gap.sum()), "commands": int((driven & (row < 0)).sum())}
    good = driven & (row >= 0) & ~states["fallen"][before].astype(bool)
    good &= commands["has_goal"].astype(bool)[row] if len(commands["step"]) else False
    before, row = before[good], row[good]
    applied = {name: column[row] for name, column in commands.items()}
    found = _made(states, before, applied, scenario)
    same_goal = np.ones(max(len(row) - 1, 0), dtype=bool)
    for name in ("goal_id", "goal.x", "goal.y"):
        same_goal &= applied[name][1:] == applied[name][:-1]
    return _cut(found, same_goal & (np.diff(before) == 1)), lost


def _made(
    states: Columns, before: np.ndarray, applied: Columns, scenario: Scenario
) -> Transitions:
    """Return the transitions from the states `before`, (M,), under the commands `applied`."""
    goal = applied["goal.x"], applied["goal.y"]
    observation, _ = _observed(states, before, *goal)
    following, distance = _observed(states, before + 1, *goal)
    lean, rate, acceleration, error = following[:, 2:].T
    terms = reward_terms(lean, rate, acceleration, error, scenario.reward)
    fallen = states["fallen"][before + 1].astype(bool)
    return Transitions(
        episode=states["episode"][before].astype(np.int64),
        step=states["step"][before].astype(np.int64),
        observation=observation,
        action=np.stack([applied[n] for n in ("torque", "displacement", "pedal_force")], axis=1),
        reward=np.asarray(sum(terms.values())),
        next_observation=following,
        terminated=~fallen & (distance <= scenario.goal_radius),
        truncated=np.zeros(len(before), dtype=bool),
        fallen=fallen,
        policy=applied["policy"],
        time=states["log_time"][before + 1],
    )


def _observed(
    states: Columns, rows: np.ndarray, goal_x: np.ndarray, goal_y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the six states (M, 6) towards the goals, and the distances to them (M,) in m."""
    rear_x, rear_y = states["rear_contact.x"][rows], states["rear_contact.y"][rows]
    front_x, front_y = states["front_contact.x"][rows], states["front_contact.y"][rows]
    heading = heading_between(rear_x, rear_y, front_x, front_y)
    if states.get("plant_state", np.empty((0, 0))).size:  # front and rear do not give it
        heading = yaw_to_heading(states["heading"][rows])
    error = heading_error(heading, rear_x, rear_y, goal_x, goal_y)
    columns = [mirror(name, states[name][rows]) for name in OBSERVATION_FIELDS[:-1]]
    return np.stack([*columns, error], axis=1), np.hypot(goal_x - rear_x, goal_y - rear_y)


def _applied(states: Columns, run: np.ndarray, rows: np.ndarray, commands: Columns) -> np.ndarray:
    """Return for each state of `rows` (M,) the row of its command, -1 if that is lost."""
    starts = states["recorded_order"][np.flatnonzero(np.diff(run)) + 1]
    names = np.concatenate([states["controller"][rows], commands["controller"]]).astype(str)
    _, who = np.unique(names, return_inverse=True)
    keys = _keys(
        np.concatenate([run[rows], np.searchsorted(starts, commands["recorded_order"], "right")]),
        np.concatenate([states["episode"][rows], commands["episode"]]),
        np.concatenate([states["command_step"][rows], commands["step"].astype(np.int64)]),
        who,
    )
    wanted, there = keys[: len(rows)], keys[len(rows) :]
    order = np.argsort(there, kind="stable")
    action = np.stack([commands[n] for n in ("torque", "displacement", "pedal_force")], axis=1)
    order = order[np.isfinite(action).all(axis=1)[order]]
    if not len(order):
        return np.full(len(rows), -1)
    place = np.minimum(np.searchsorted(there[order], wanted), len(order) - 1)
    return np.where(there[order][place] == wanted, order[place], -1)


def _keys(*columns: np.ndarray) -> np.ndarray:
    """Return one integer per row; equal if all columns are equal."""
    key = np.zeros(len(columns[0]), dtype=np.int64)
    for column in columns:
        values, code = np.unique(column, return_inverse=True)
        key = key * len(values) + code
    return key


def _runs(states: Columns) -> np.ndarray:
    """Return (n,) the index of each state's simulator process: a new one counts from 1 again."""
    episode, step = (states[name].astype(np.int64) for name in ("episode", "step"))
    back = (np.diff(episode) < 0) | ((np.diff(episode) == 0) & (np.diff(step) < 0))
    return np.concatenate([[0], np.cumsum(back)]) if len(step) else np.zeros(0, dtype=np.int64)


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


def _rows(found: Transitions, mask: np.ndarray) -> Transitions:
    values: dict[str, Any] = {n: column[mask] for n, column in vars(found).items()}
    return Transitions(**values)
