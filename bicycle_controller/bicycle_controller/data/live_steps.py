"""Steps of a running bicycle, from its messages, for the transition builder."""

from __future__ import annotations

import time
from collections import deque
from typing import Any

import numpy as np

from bicycle_controller.data.announced_episodes import AnnouncedEpisodes
from bicycle_controller.data.transition_builder import COMMANDED, READ, Columns

LONGEST_WAIT = 40
"""Newer states that may arrive before a state stops waiting for its echo."""
MOST_ECHOES = 5_000
"""Echoes that are kept for states that have not come."""
MOST_UNANNOUNCED = 4_000
"""States that may wait for the announcement of their episode; with more they are dropped."""

_STATE = ("lean_angle", "lean_rate", "lean_acceleration", "steer_angle", "steer_rate", "heading")
_NOTHING = (False, 0.0, 0.0, 0.0, False, 0, np.nan, np.nan, "")
"""Values of COMMANDED without a command."""
_COLUMNS = (
    "run",
    "episode",
    "step",
    *_STATE,
    "rear_contact.x",
    "rear_contact.y",
    "front_contact.x",
    "front_contact.y",
    "fallen",
    "own_heading",
    "log_time",
    "command_source",
    *(f"applied.{name}" for name in COMMANDED),
)
_UNKNOWN = 0
"""Source of a step whose echo never came."""
Key = tuple[int, int]


class LiveSteps:
    """Joins the messages of states and of command echoes, which may come in any order."""

    def __init__(self, announced: AnnouncedEpisodes | None = None) -> None:
        """Start before the first message.

        Args:
            announced: tells which episodes are wanted; None for all.
        """
        self._announced = announced
        self._open: tuple[int, int] | None = None
        self._wanted = announced is None
        self._anew = False
        self._states: deque[tuple[Key, tuple[Any, ...], tuple[Any, ...] | None]] = deque()
        self._echoes: dict[Key, tuple[Any, ...]] = {}
        self._last: Key = (0, -1)
        self._run = 0

    def announce(self, episode: int, learned: bool) -> None:
        """Take in the announcement of an episode.

        A restarted simulator is noticed by its step numbers, which begin at 0 again. If the one
        before never left step 0, only this announcement tells the two apart.

        Args:
            episode: its number.
            learned: True if its bicycle is the one that is learned from.
        """
        assert self._announced is not None
        self._announced.announce(episode, learned)
        self._anew = self._open == (self._run, episode) and self._last == (episode, 0)

    def add_echo(self, message: Any) -> None:
        """Take in a CommandEcho."""
        command, row = message.command, _NOTHING
        if message.command_source in (message.SOURCE_FRESH, message.SOURCE_HELD):
            row = (
                True,
                command.torque,
                command.displacement,
                command.pedal_force,
                command.has_goal,
                command.goal_id,
                command.goal.x,
                command.goal.y,
                command.policy,
            )
        self._echoes[message.episode, message.step] = (message.command_source, *row)
        while len(self._echoes) > MOST_ECHOES:
            del self._echoes[next(iter(self._echoes))]

    def add_state(self, message: Any) -> None:
        """Take in a BicycleState; one that repeats the last is left out."""
        key = message.episode, message.step
        if key == self._last and not self._anew:
            return
        self._run += self._anew or key < self._last
        self._last, self._anew = key, False
        rear, front = message.rear_contact, message.front_contact
        row = (
            self._run,
            *key,
            *(getattr(message, name) for name in _STATE),
            rear.x,
            rear.y,
            front.x,
            front.y,
            message.fallen,
            bool(message.plant_state) or message.estimated,
            time.time(),
        )
        self._states.append((key, row, self._echoes.pop(key, None)))

    def take(self) -> Columns:
        """Return the wanted, complete steps in order, as a table with the columns READ."""
        rows = []
        while self._states:
            key, row, echo = self._states[0]
            if not self._is_decided(row[0], key[0]):
                break
            if not self._wanted:
                self._echoes.pop(key, None)
                self._states.popleft()
                continue
            echo = echo or self._echoes.pop(key, None)
            if echo is None and len(self._states) <= LONGEST_WAIT:
                break
            self._states.popleft()
            rows.append(row + (echo or (_UNKNOWN, *_NOTHING)))
        columns = zip(*rows, strict=True) if rows else ((),) * len(_COLUMNS)
        table = {
            name: _column(name, values) for name, values in zip(_COLUMNS, columns, strict=True)
        }
        return {name: table[name] for name in READ}

    def _is_decided(self, run: int, episode: int) -> bool:
        """Return True once it is known whether the steps of an episode are wanted."""
        if self._announced is None or self._open == (run, episode):
            return True
        wanted = self._announced.begin(episode)
        if wanted is None and len(self._states) <= MOST_UNANNOUNCED:
            return False
        self._open, self._wanted = (run, episode), bool(wanted)
        return True


def _column(name: str, values: tuple[Any, ...]) -> np.ndarray:
    """Return the values of a column as an array."""
    if name == "applied.policy":
        column = np.empty(len(values), dtype=object)
        column[:] = values
        return column
    flags = ("fallen", "own_heading", "applied.known", "applied.has_goal")
    whole = ("run", "episode", "step", "command_source", "applied.goal_id")
    kind = np.bool_ if name in flags else np.int64 if name in whole else np.float64
    return np.array(values, dtype=kind)
