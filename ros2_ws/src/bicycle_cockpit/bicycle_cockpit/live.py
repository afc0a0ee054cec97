"""What is known of the ride that goes on, and how it is told to the pages."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Any

from bicycle_cockpit.goal_book import GoalBook
from bicycle_cockpit.loop_stats import LoopStats
from bicycle_cockpit.samples import COLUMNS, Sample, plain, plain_row
from bicycle_sim.reward import RewardWeights

HISTORY = 4_800
"""Rows that a page gets when it comes: two minutes at 40 Hz."""
SHORTEST = 0.015
"""s of the clock between two rows: a ride in lock-step makes more steps than a page can draw."""
SILENCE = 1.0
"""s without a state after which there is no simulator."""
MOST_EVENTS = 60
MOST_TRAINING = 1_000
"""Reports of the trainer that a page gets when it comes."""


class Live:
    """The newest state of everything; all methods belong to one thread.

    Attributes:
        goals: which lie ahead.
        loop: how punctual the simulator is.
        mode: the simulator's own word: riding, paused, held or fallen.
        weights: of the reward's terms.
        names: by which names the policies that ride are offered, as far as is known.
        facts: of the episode, for the page: seed, scenario, limits, ...
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Begin knowing nothing; `clock` is steady, s."""
        self._clock = clock
        self.goals = GoalBook()
        self.loop = LoopStats(clock)
        self.mode = "held"
        self.weights = RewardWeights()
        self.facts: dict[str, Any] = {}
        self.policy = ""
        self.names: dict[str, str] = {}
        self.commands_text = ""
        self._rows: deque[list[float | None]] = deque(maxlen=HISTORY)
        self._new: list[list[float | None]] = []
        self._training: deque[dict[str, Any]] = deque(maxlen=MOST_TRAINING)
        self._events: deque[dict[str, Any]] = deque(maxlen=MOST_EVENTS)
        self._heard = self._kept = -1e9
        self._last_step: tuple[float, float] | None = None
        self._time = 0.0

    @property
    def time(self) -> float:
        """s of simulated time."""
        return self._time

    @property
    def position(self) -> tuple[float, float] | None:
        """m, where the rear contact is; None before the first state."""
        if not self._rows:
            return None
        x, y = (self._rows[-1][COLUMNS.index(name)] for name in "xy")
        return None if x is None or y is None else (x, y)

    @property
    def hears_simulator(self) -> bool:
        """Whether states arrive."""
        return self._clock() - self._heard < SILENCE

    def due(self) -> bool:
        """Note that a state has come; whether it is to be turned into a row."""
        self._heard = self._clock()
        return self._heard - self._kept >= SHORTEST

    def add(self, sample: Sample) -> bool:
        """Take in a state; whether it is a new step, not one that was published again."""
        step = sample.episode, sample.step
        if step == self._last_step:
            return False
        if sample.t < self._time:
            self._rows.clear()  # the simulator was started anew
        self._last_step, self._time, self._kept = step, sample.t, self._clock()
        row = plain_row(sample)
        self._rows.append(row)
        self._new.append(row)
        return True

    def event(self, level: str, text: str, **more: Any) -> dict[str, Any]:
        """Note that something happened; returns what to tell the pages.

        Args:
            level: good, info, warn or bad.
            text: one line.
            more: such as the kind and the place of a goal.
        """
        made = {"type": "event", "level": level, "text": text, "t": plain(self._time), **more}
        self._events.append(made)
        return made

    def trained(self, facts: dict[str, Any]) -> None:
        """Keep a report of the trainer; one for each number of updates."""
        if not self._training or facts["updates"] != self._training[-1]["updates"]:
            self._training.append(facts)

    def hello(self) -> dict[str, Any]:
        """All that a new page must know."""
        return {
            "type": "hello",
            "columns": COLUMNS,
            "rows": list(self._rows),
            "events": list(self._events),
            "training": list(self._training),
            "facts": self.facts,
        }

    def frame(self) -> dict[str, Any] | None:
        """The rows since the last call; None when there are none."""
        rows, self._new = self._new, []
        return {"type": "frame", "rows": rows} if rows else None

    def status(self, **more: Any) -> dict[str, Any]:
        """What changes slowly; `more` is told beside it."""
        return {
            "type": "status",
            "mode": self.mode if self.hears_simulator else "silent",
            "t": plain(self._time),
            "policy": self.policy,
            "controller": self.names.get(self.policy, self.policy.partition("@")[0]),
            "commands": self.commands_text,
            "goal": self.goals.active,
            "ahead": self.goals.ahead[:200],
            "loop": self.loop.figures(),
            **more,
        }
