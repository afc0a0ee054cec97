"""Validation of commands: which ones the simulator obeys, and the warning about the others.

The sender's stamps are not checked, because clocks differ. A command is judged by the step that
it answers and by its arrival on this machine's steady clock.
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
"""Time without a kind of rejection after which it is reported again (s)."""

IN_FLIGHT = 1.0
"""Time after a reset in which answers to the old episode are not reported (s)."""

_NAMES = ("torque", "displacement", "pedal force")
_UNITS = ("N m", "m", "N")


class RejectionReason(Enum):
    """Reason why a command was rejected; the values are the counters' names in diagnostics."""

    NOT_FINITE = "not finite"
    OUT_OF_RANGE = "out of range"
    WRONG_EPISODE = "other episode"
    STALE = "stale"
    FUTURE = "future step"
    SECOND_CONTROLLER = "second controller"
    DUPLICATE = "repeated"


@dataclass(frozen=True)
class Decision:
    """Decision about one command."""

    reason: RejectionReason | None = None
    """Reason of the rejection; None if the command is accepted."""
    warning: str = ""
    """Rejection in one line with the remedy; empty if one of its kind was reported lately."""

    @property
    def accepted(self) -> bool:
        """True if the command is obeyed."""
        return self.reason is None


class CommandValidator:
    """Accepts one controller's commands in order and rejects everything else.

    `newest` is the last command accepted in this episode, None before the first.
    """

    def __init__(
        self,
        limits: np.ndarray,
        release: float = 0.25,
        max_age: int = 10,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start without a controller.

        Args:
            limits: (3,) largest |T| (N m), |d| (m), |F| (N).
            release: silence in s after which another controller may take over.
            max_age: largest number of steps between the answered state and the current one.
            clock: steady clock, s.
        """
        self.limits = limits
        self.release = release
        self.max_age = max_age
        self.newest: Command | None = None
        self.accepted = 0
        self.rejected: Counter[RejectionReason] = Counter()
        self._clock = clock
        self._owner: str | None = None
        self._heard = clock()
        self._begun = clock()
        self._last_seen: dict[RejectionReason, float] = {}
        self._episode = 0

    def begin(self, episode: int) -> None:
        """Expect the commands of a new episode."""
        self._episode = episode
        self._begun = self._clock()
        self.newest = None

    @property
    def owner(self) -> str | None:
        """Controller whose commands are obeyed, while it is alive; None without one."""
        return self._owner if self.silence() <= self.release else None

    def silence(self) -> float:
        """Return the time since the last valid command, s."""
        return self._clock() - self._heard

    def keep_alive(self) -> None:
        """Restart the command timeout."""
        self._heard = self._clock()

    def decide(self, command: Command, step: int) -> Decision:
        """Accept `command` as the newest or return why not; `step` is the current state's."""
        reason, text = self._judge(command, step)
        if reason is RejectionReason.DUPLICATE and command.controller == self._owner:
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

    def _judge(self, command: Command, step: int) -> tuple[RejectionReason | None, str]:
        """Return the reason and a sentence if the command is rejected; (None, "") if accepted."""
        for value, limit, name, unit in zip(
            command.action, self.limits, _NAMES, _UNITS, strict=True
        ):
            if not math.isfinite(value):
                return (
                    RejectionReason.NOT_FINITE,
                    f"its {name} is {value}: check the policy it runs",
                )
            if abs(value) > limit:
                return RejectionReason.OUT_OF_RANGE, (
                    f"its {name} {value:g} {unit} is beyond the scenario's {limit:g} {unit}: load "
                    "a policy for these limits, or start the simulator with another scenario"
                )
        if command.goal is not None and not all(map(math.isfinite, command.goal)):
            return RejectionReason.NOT_FINITE, f"its goal is {command.goal}: send finite goals"
        return self._judge_order(command, step)

    def _judge_order(self, command: Command, step: int) -> tuple[RejectionReason | None, str]:
        """Judge the sender and the answered state, as part of `_judge`."""
        owner = self.owner
        if command.episode != self._episode:
            return RejectionReason.WRONG_EPISODE, (
                f"it answers episode {command.episode}, this is episode {self._episode}: answer "
                "the newest state"
            )
        if owner is not None and command.controller != owner:
            return RejectionReason.SECOND_CONTROLLER, (
                f"{owner!r} is in charge: stop one of the two, or give one another "
                "ROS_DOMAIN_ID or namespace"
            )
        if command.step > step:
            return RejectionReason.FUTURE, (
                f"the bicycle is at step {step} only: answer with the step number of a state"
            )
        if self.newest is not None and command.step == self.newest.step:
            return RejectionReason.DUPLICATE, ""
        if self.newest is not None and command.step < self.newest.step:
            return (
                RejectionReason.STALE,
                f"step {self.newest.step} is answered already: send in order",
            )
        if step - command.step > self.max_age:
            return RejectionReason.STALE, (
                f"the bicycle is at step {step} by now: use a faster controller, a smaller "
                "real_time_factor or pace:=lockstep"
            )
        return None, ""

    def _report(self, reason: RejectionReason, text: str, old: bool) -> str:
        """Return the log line when `reason` begins; empty while it lasts."""
        now = self._clock()
        last = self._last_seen.get(reason, -math.inf)
        self._last_seen[reason] = now
        in_flight = old and now - self._begun <= IN_FLIGHT
        if reason is RejectionReason.DUPLICATE or in_flight or now - last < QUIET:
            return ""
        return text
