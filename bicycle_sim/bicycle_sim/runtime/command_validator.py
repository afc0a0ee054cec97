"""Which commands the simulator obeys, and what it says about the others.

Sender's stamps are never judged: clocks differ. What counts is the step that a command answers
and when it arrives by this machine's steady clock.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from bicycle_common.types import Command

QUIET = 5.0
"""s without a kind of rejection after which the next one is reported again."""

IN_FLIGHT = 1.0
"""s after a reset in which answers to the old episode are no trouble."""

_NAMES = ("torque", "displacement", "pedal force")
_UNITS = ("N m", "m", "N")


class Reason(Enum):
    """Why a command was not obeyed; the values are the counters' names in diagnostics."""

    NOT_FINITE = "not finite"
    OUT_OF_RANGE = "out of range"
    WRONG_EPISODE = "other episode"
    STALE = "stale"
    FUTURE = "future step"
    SECOND_CONTROLLER = "second controller"
    DUPLICATE = "repeated"


@dataclass(frozen=True)
class Decision:
    """What becomes of one command."""

    reason: Reason | None = None
    """Why it is not obeyed; None when it is."""
    warning: str = ""
    """One line with the remedy; empty unless this is the first of its kind for a while."""

    @property
    def accepted(self) -> bool:
        """Whether it is obeyed."""
        return self.reason is None


class CommandValidator:
    """Takes one controller's commands in order and refuses everything else.

    `newest` is the last command accepted in this episode, None before the first.
    """

    def __init__(
        self,
        limits: np.ndarray,
        release: float = 0.25,
        max_age: int = 10,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Open the gate.

        Args:
            limits: (3,) largest |T| (N m), |d| (m), |F| (N).
            release: s of silence after which another controller may take over.
            max_age: steps that the answered state may be behind the present one.
            clock: steady, s.
        """
        self.limits = limits
        self.release = release
        self.max_age = max_age
        self.newest: Command | None = None
        self.accepted = 0
        self.rejected: Counter[Reason] = Counter()
        self._clock = clock
        self._owner: str | None = None
        self._heard = clock()
        self._begun = clock()
        self._last_seen: dict[Reason, float] = {}
        self._episode = 0

    def begin(self, episode: int) -> None:
        """Expect the commands of a new episode."""
        self._episode = episode
        self._begun = self._clock()
        self.newest = None

    @property
    def owner(self) -> str | None:
        """The controller whose commands are obeyed, while it is alive."""
        return self._owner if self.silence() <= self.release else None

    def silence(self) -> float:
        """s since the last valid command."""
        return self._clock() - self._heard

    def keep_alive(self) -> None:
        """Take the present for the time of the last valid command, after a pause."""
        self._heard = self._clock()

    def decide(self, command: Command, step: int) -> Decision:
        """Accept `command` as the newest, or say why not; `step` is the present state's."""
        reason, text = self._judge(command, step)
        if reason is Reason.DUPLICATE and command.controller == self._owner:
            self._heard = self._clock()
        if reason is not None:
            self.rejected[reason] += 1
            old = command.episode < self._episode
            return Decision(reason, self._report(reason, text, old))
        self.newest = command
        self.accepted += 1
        self._owner = command.controller
        self._heard = self._clock()
        return Decision()

    def _judge(self, command: Command, step: int) -> tuple[Reason | None, str]:
        """Why the command is refused, and a sentence about it; (None, "") when it is not."""
        for value, limit, name, unit in zip(
            command.action, self.limits, _NAMES, _UNITS, strict=True
        ):
            if not math.isfinite(value):
                return Reason.NOT_FINITE, f"its {name} is {value}: check the policy it runs"
            if abs(value) > limit:
                return Reason.OUT_OF_RANGE, (
                    f"its {name} {value:g} {unit} is beyond the scenario's {limit:g} {unit}: load "
                    "a policy for these limits, or start the simulator with another scenario"
                )
        if command.goal is not None and not all(map(math.isfinite, command.goal)):
            return Reason.NOT_FINITE, f"its goal is {command.goal}: send finite goals"
        return self._judge_order(command, step)

    def _judge_order(self, command: Command, step: int) -> tuple[Reason | None, str]:
        """The part of `_judge` about who sent it and which state it answers."""
        owner = self.owner
        if command.episode != self._episode:
            return Reason.WRONG_EPISODE, (
                f"it answers episode {command.episode}, this is episode {self._episode}: answer "
                "the newest state"
            )
        if owner is not None and command.controller != owner:
            return Reason.SECOND_CONTROLLER, (
                f"{owner!r} is in charge: stop one of the two, or give one another "
                "ROS_DOMAIN_ID or namespace"
            )
        if command.step > step:
            return Reason.FUTURE, (
                f"the bicycle is at step {step} only: answer with the step number of a state"
            )
        if self.newest is not None and command.step == self.newest.step:
            return Reason.DUPLICATE, ""
        if self.newest is not None and command.step < self.newest.step:
            return Reason.STALE, f"step {self.newest.step} is answered already: send in order"
        if step - command.step > self.max_age:
            return Reason.STALE, (
                f"the bicycle is at step {step} by now: use a faster controller, a smaller "
                "real_time_factor or pace:=lockstep"
            )
        return None, ""

    def _report(self, reason: Reason, text: str, old: bool) -> str:
        """The line for the log when `reason` begins, nothing while it lasts."""
        now = self._clock()
        last = self._last_seen.get(reason, -math.inf)
        self._last_seen[reason] = now
        in_flight = old and now - self._begun <= IN_FLIGHT
        if reason is Reason.DUPLICATE or in_flight or now - last < QUIET:
            return ""
        return text
