"""Transitions (s, a, r, s') from states, the commands that led to them, and the goals' ends.

The one place that makes them, live or from a bag. Each step is a transition towards the goal that
its command pursued. A pursuit ends as terminated at its goal, and is truncated where it was cut:
by a reset, another goal, no command, or a lost message.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from bicycle_common.conventions import mirror
from bicycle_common.geometry import heading_between, heading_error, yaw_to_heading
from bicycle_common.observation import ACTION_FIELDS, OBSERVATION_FIELDS
from bicycle_common.types import CommandSource
from bicycle_sim.task.reward import reward_terms
from bicycle_sim.task.scenario import Scenario

Columns = dict[str, np.ndarray]
"""One array per field, one row per step, in the order of the ride; names as of
`bicycle_bag.steps`, values in REP-103 signs."""

BODY = (
    "episode",
    "step",
    *OBSERVATION_FIELDS[:-1],
    "heading",
    "rear_contact.x",
    "rear_contact.y",
    "front_contact.x",
    "front_contact.y",
    "fallen",
)
"""Columns of a state that are read."""
COMMANDED = (
    "known",
    "torque",
    "displacement",
    "pedal_force",
    "has_goal",
    "goal_id",
    "goal.x",
    "goal.y",
    "policy",
)
"""Columns of the command that led to a state, each with `applied.` before it."""
OTHERS = ("command_source", "log_time", "own_heading", "run")
"""Source of the step's input; time of receipt, s; True if `heading` is to be taken, not the line
between the wheels; number of the simulator's process."""
READ = (*BODY, *(f"applied.{name}" for name in COMMANDED), *OTHERS)
"""All columns of a table of steps."""

Reached = tuple[float, float, float]
"""Number and place (m) of a goal that the controller says was reached."""


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

    def rows(self, mask: np.ndarray | slice) -> Transitions:
        """Return some of the rows."""
        values: dict[str, Any] = {name: column[mask] for name, column in vars(self).items()}
        return Transitions(**values)


class TransitionBuilder:
    """Makes the transitions of one bicycle from its steps, piece by piece or all at once.

    The last transition of a piece waits for the next one, which shows whether the pursuit goes on.

    Attributes:
        arrived: number of transitions made.
        lost: number of steps that are missing within episodes.
        unknown: number of steps whose command is not known.
        policy: id of the policy that chose the last action; empty before the first.
    """

    def __init__(self, scenario: Scenario) -> None:
        """Prepare for a ride; the scenario's reward and goal radius are used."""
        self._scenario = scenario
        self._last: Columns = {}
        self._rows = 0
        self._waiting: _Pursuits | None = None
        self.arrived = self.lost = self.unknown = 0
        self.policy = ""

    def add(self, steps: Columns, reached: Collection[Reached] = ()) -> Transitions:
        """Take in the next steps of the ride.

        Args:
            steps: a table with the columns READ, (n,); a step may be repeated.
            reached: goals known to be reached, even if farther away than the scenario's radius.

        Returns:
            The transitions that are complete now, in order.
        """
        table = {name: steps[name] for name in READ}
        if self._last:
            table = {n: np.concatenate([self._last[n], c]) for n, c in table.items()}
        table = _without_repeats(table)
        pursuits = self._pursuits(table)
        self._rows += max(0, len(table["step"]) - 1)
        self._last = {name: column[-1:] for name, column in table.items()}
        if self._waiting is not None:
            pursuits = _Pursuits.join(self._waiting, pursuits)
        self._waiting = None
        found = pursuits.cut(reached)
        if not len(pursuits.at):
            return found
        self.policy = str(found.policy[-1])
        ended = found.terminated[-1] or found.fallen[-1]
        if ended or pursuits.at[-1] != self._rows - 1:
            return found
        self._waiting = pursuits.rows(slice(-1, None))
        return found.rows(slice(0, -1))

    def finish(self, reached: Collection[Reached] = ()) -> Transitions:
        """Return the transition that waits, if any, truncated; the next step begins anew."""
        waiting, self._waiting, self._last = self._waiting, None, {}
        return _Pursuits.none().cut() if waiting is None else waiting.cut(reached)

    def all(self, steps: Columns, reached: Collection[Reached] = ()) -> Transitions:
        """Return all transitions of a whole ride."""
        return Transitions.join([self.add(steps, reached), self.finish(reached)])

    def _pursuits(self, table: Columns) -> _Pursuits:
        """Return the transitions between the rows of a table, not yet cut."""
        same = (np.diff(table["episode"].astype(np.int64)) == 0) & (np.diff(table["run"]) == 0)
        ahead = np.diff(table["step"].astype(np.int64))
        known = table["applied.known"].astype(bool)[1:]
        driven = table["command_source"][1:] != CommandSource.ZERO
        ridden = same & (ahead == 1)
        self.lost += int((ahead - 1)[same].sum())
        self.unknown += int((ridden & driven & ~known).sum())
        good = ridden & known & ~table["fallen"].astype(bool)[:-1]
        good &= table["applied.has_goal"].astype(bool)[1:]
        before = np.flatnonzero(good)
        transitions = _transitions(table, before, self._scenario)
        self.arrived += len(transitions)
        goal = [table[f"applied.{name}"][before + 1] for name in ("goal_id", "goal.x", "goal.y")]
        return _Pursuits(
            transitions, np.stack(goal, axis=1).astype(np.float64), self._rows + before
        )


@dataclass(frozen=True)
class _Pursuits:
    """M transitions with what shows where a pursuit ends."""

    transitions: Transitions
    goal: np.ndarray
    """(M, 3) number and place of the goal."""
    at: np.ndarray
    """(M,) number of the step in the ride."""

    @classmethod
    def none(cls) -> _Pursuits:
        """Return no transition."""
        empty, flags = np.zeros(0), np.zeros(0, dtype=bool)
        numbers = empty.astype(np.int64)
        transitions = Transitions(
            episode=numbers,
            step=numbers,
            observation=np.zeros((0, len(OBSERVATION_FIELDS))),
            action=np.zeros((0, len(ACTION_FIELDS))),
            reward=empty,
            next_observation=np.zeros((0, len(OBSERVATION_FIELDS))),
            terminated=flags,
            truncated=flags,
            fallen=flags,
            policy=empty.astype(object),
            time=empty,
        )
        return cls(transitions, np.zeros((0, 3)), numbers)

    @classmethod
    def join(cls, first: _Pursuits, second: _Pursuits) -> _Pursuits:
        """Concatenate two parts."""
        return cls(
            Transitions.join([first.transitions, second.transitions]),
            np.concatenate([first.goal, second.goal]),
            np.concatenate([first.at, second.at]),
        )

    def rows(self, mask: slice) -> _Pursuits:
        """Return some of the rows."""
        return _Pursuits(self.transitions.rows(mask), self.goal[mask], self.at[mask])

    def cut(self, reached: Collection[Reached] = ()) -> Transitions:
        """Return the transitions with the ends of pursuits marked, the last one's included."""
        transitions = self.transitions
        goes_on = (np.diff(self.at) == 1) & (self.goal[1:] == self.goal[:-1]).all(axis=1)
        last = np.append(~goes_on, True)[: len(transitions)]
        open_ended = last & ~transitions.terminated & ~transitions.fallen
        there = np.zeros(len(transitions), dtype=bool)
        for row in np.flatnonzero(open_ended) if reached else ():
            there[row] = tuple(self.goal[row]) in reached
        return replace(
            transitions,
            terminated=transitions.terminated | there,
            truncated=transitions.truncated | (open_ended & ~there),
        )


def _transitions(table: Columns, before: np.ndarray, scenario: Scenario) -> Transitions:
    """Return the transitions from the rows `before`, (M,), each to the next one."""
    after = before + 1
    goal = table["applied.goal.x"][after], table["applied.goal.y"][after]
    observation, _ = _observed(table, before, *goal)
    following, distance = _observed(table, after, *goal)
    lean, rate, acceleration, error = following[:, 2:].T
    terms = reward_terms(lean, rate, acceleration, error, scenario.reward)
    fallen = table["fallen"].astype(bool)[after]
    return Transitions(
        episode=table["episode"][before].astype(np.int64),
        step=table["step"][before].astype(np.int64),
        observation=observation,
        action=np.stack([table[f"applied.{name}"][after] for name in ACTION_FIELDS], axis=1),
        reward=np.asarray(sum(terms.values())),
        next_observation=following,
        terminated=~fallen & (distance <= scenario.goal_radius),
        truncated=np.zeros(len(before), dtype=bool),
        fallen=fallen,
        policy=table["applied.policy"][after],
        time=table["log_time"][after],
    )


def _observed(
    table: Columns, rows: np.ndarray, goal_x: np.ndarray, goal_y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the six states (M, 6) towards the goals, and the distances to them (M,) in m."""
    rear_x, rear_y = table["rear_contact.x"][rows], table["rear_contact.y"][rows]
    front_x, front_y = table["front_contact.x"][rows], table["front_contact.y"][rows]
    heading = np.where(
        table["own_heading"][rows],
        yaw_to_heading(table["heading"][rows]),
        heading_between(rear_x, rear_y, front_x, front_y),
    )
    error = heading_error(heading, rear_x, rear_y, goal_x, goal_y)
    columns = [mirror(name, table[name][rows]) for name in OBSERVATION_FIELDS[:-1]]
    return np.stack([*columns, error], axis=1), np.hypot(goal_x - rear_x, goal_y - rear_y)


def _without_repeats(table: Columns) -> Columns:
    """Return a table without the steps that repeat the one before, as while a bicycle is held."""
    new = np.ones(len(table["step"]), dtype=bool)
    new[1:] = (np.diff(table["episode"].astype(np.int64)) != 0) | (
        np.diff(table["step"].astype(np.int64)) != 0
    )
    return {name: column[new] for name, column in table.items()}
