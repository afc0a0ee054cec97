"""State of the current ride, and its form for the pages."""

from __future__ import annotations

import math
import secrets
import time
from collections import deque
from collections.abc import Callable
from dataclasses import asdict
from itertools import islice
from typing import Any

from bicycle_cockpit.goal_list import GoalList
from bicycle_cockpit.loop_stats import LoopStats
from bicycle_cockpit.rate_limiter import RateLimiter
from bicycle_cockpit.riders import rider
from bicycle_cockpit.rows import Rows, row_text
from bicycle_cockpit.samples import COLUMNS, Sample, plain
from bicycle_cockpit.who_rides import WhoRides
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant
from bicycle_sim.task.reward import RewardWeights
from bicycle_sim.task.scenario import Scenario

HISTORY = 4_800
"""Rows sent to a new page: two minutes at 40 Hz."""
PIECE = 400
"""Rows of the history in one message: 10 s."""
RATE = 65.0
"""Rows per second: a ride in lock-step makes more steps than a page can draw."""
BURST = 400.0
"""Rows at once: steps that queued while this process was busy must not be omitted."""
SILENCE = 1.0
"""Time without a state after which the simulator counts as absent (s)."""
MOST_EVENTS = 200
MOST_TRAINING = 1_000
"""Reports of the trainer sent to a new page."""


class RideState:
    """Newest state of everything; all methods belong to one thread.

    Attributes:
        session: id of this cockpit: a page that reconnects knows which data it has already.
        goals: goals ahead.
        loop: punctuality of the simulator.
        who: riding policy.
        mode: the simulator's mode: riding, paused, held or fallen.
        paused: True if time stands still, even under a bicycle that waits or lies.
        weights: of the reward's terms.
        names: catalogue names of the riding policies, as far as known.
        facts: of the episode, for the page: seed, scenario, limits, ...
        setting: bicycle and scenario; None before they are known.
        unlike: difference of the ride from the training of the controller's policy.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Start without data; `clock` is steady, s."""
        self._clock = clock
        self.session = secrets.token_hex(8)
        self.goals = GoalList()
        self.loop = LoopStats(clock)
        self.who = WhoRides(clock)
        self.mode = "held"
        self.paused = False
        self.weights = RewardWeights()
        # Until a simulator tells its bicycle, a page draws the one that is ridden by default.
        self.facts: dict[str, Any] = {"geometry": asdict(registry.default().geometry)}
        self.setting: tuple[Plant[Any], Scenario] | None = None
        self.unlike = ""
        self.names: dict[str, str] = {}
        self.commands_text = ""
        self._policies: dict[str, int] = {}
        self._ride = self._count = self._events_told = 0
        self._rows: deque[str] = deque(maxlen=HISTORY)
        self._new: list[str] = []
        self._training: deque[dict[str, Any]] = deque(maxlen=MOST_TRAINING)
        self._events: deque[dict[str, Any]] = deque(maxlen=MOST_EVENTS)
        self._heard = -1e9
        self._room = RateLimiter(RATE, BURST, clock)
        self._last: Sample | None = None

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return 0.0 if self._last is None else self._last.t

    @property
    def position(self) -> tuple[float, float] | None:
        """Position of the rear contact, m; None before the first state."""
        last = self._last
        known = last is not None and math.isfinite(last.x) and math.isfinite(last.y)
        return (last.x, last.y) if last is not None and known else None

    @property
    def at_start(self) -> bool:
        """True if the episode has no step yet."""
        return self._last is None or self._last.step == 0

    @property
    def hears_simulator(self) -> bool:
        """True if states arrive."""
        return self._clock() - self._heard < SILENCE

    def due(self) -> bool:
        """Count a received state; return True if it is to become a row."""
        self._heard = self._clock()
        return self._room.take()

    def add(self, sample: Sample) -> bool:
        """Take in a state; return True if it is a new step, not a repeated one."""
        last = self._last
        again = last is not None and (sample.episode, sample.step) == (last.episode, last.step)
        if last is not None and again and sample.body == last.body:
            return False
        # After a restart of the simulator; one that had not begun to ride has the same first step.
        if last is not None and (again or sample.t < last.t):
            self._ride += 1
            self._count = 0
            self._rows.clear()
            self._new.clear()
        self._last = sample
        text = row_text(sample)
        self._rows.append(text)
        self._new.append(text)
        self._count += 1
        return True

    def policy_number(self, policy: str) -> float:
        """Return the number of a policy in the rows; NaN for none."""
        return self._policies.setdefault(policy, len(self._policies)) if policy else math.nan

    def riders(self) -> dict[str, Any]:
        """Return the policies in the rows, in the order of their numbers."""
        known = (rider(policy, self.names) for policy in self._policies)
        return {"type": "riders", "riders": [asdict(one) for one in known]}

    def event(self, level: str, text: str, **more: Any) -> dict[str, Any]:
        """Record an event; return its form for the pages.

        Args:
            level: good, info, warn or bad.
            text: one line.
            more: such as its kind; what has a kind happened where the bicycle is, unless `x`
                and `y` (m) say otherwise.
        """
        place = self.position
        if "kind" in more and place is not None:
            more = {"x": plain(place[0]), "y": plain(place[1]), **more}
        event = {"type": "event", "n": self._events_told, "ride": self._ride, "level": level}
        event |= {"text": text, "t": plain(self.time), **more}
        self._events_told += 1
        self._events.append(event)
        return event

    def trained(self, facts: dict[str, Any]) -> None:
        """Keep a report of the trainer; one for each number of updates."""
        if not self._training or facts["updates"] != self._training[-1]["updates"]:
            self._training.append(facts)

    def hello(self) -> dict[str, Any]:
        """Return all data for a new page except the rows, see `history`."""
        return {
            "type": "hello",
            "session": self.session,
            "ride": self._ride,
            "next": self._count - len(self._new),
            "columns": COLUMNS,
            "events": list(self._events),
            "training": list(self._training),
            "facts": self.facts,
        }

    def history(self) -> list[Rows]:
        """Return all rows except those of the next frame, in pieces, the newest first."""
        end = self._count - len(self._new)
        rows = tuple(islice(self._rows, max(0, len(self._rows) - len(self._new))))
        pieces = []
        for stop in range(len(rows), 0, -PIECE):
            piece = rows[max(0, stop - PIECE) : stop]
            pieces.append(Rows(self._ride, end - len(rows) + stop - len(piece), piece))
        return pieces

    def frame(self) -> Rows | None:
        """Return the rows since the last call; None if there are none."""
        rows, self._new = self._new, []
        return Rows(self._ride, self._count - len(rows), tuple(rows)) if rows else None

    def status(self, **more: Any) -> dict[str, Any]:
        """Return slowly changing data; `more` is added."""
        return {
            "type": "status",
            "mode": self.mode if self.hears_simulator else "silent",
            "paused": self.paused,
            "t": plain(self.time),
            "who": self._who(),
            "commands": self.commands_text,
            "goal": self._goal(),
            "ahead": self.goals.ahead[:200],
            "loop": self.loop.figures(),
            **more,
        }

    def _goal(self) -> list[float] | None:
        """Return x, y and, where one is asked for, the yaw of arrival at the active goal."""
        goals = self.goals
        if goals.active is None:
            return None
        return [*goals.active] if goals.heading is None else [*goals.active, goals.heading]

    def _who(self) -> dict[str, Any]:
        """Return the riding policy, for the pages; see `WhoRides`."""
        taken = self.who.hand_over
        chosen = self.who.chosen
        facts: dict[str, Any] = {
            "driver": asdict(rider(self.who.driver, self.names)),
            "chosen": asdict(rider(chosen, self.names)),
        }
        if taken is not None:
            facts |= {"why": taken.why, "since": plain(taken.since), "stop": taken.stop}
        return facts
