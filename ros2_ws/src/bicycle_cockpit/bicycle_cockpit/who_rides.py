"""Which policy rides, which one was chosen, and why the LQR rides instead of it.

The controller tells all three on topics of their own: each command names the policy that made
it, the diagnostics name the one in charge, and a hand-over says who takes over and why.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

SETTLED = 0.2
"""s after which a change of the riding policy is told, unless a hand-over explains it."""


@dataclass(frozen=True)
class HandOver:
    """The safety layer's word that the fallback rides."""

    policy: str
    """Id of what rides from here on."""
    why: str
    """In words."""
    since: float
    """s of simulated time."""
    stop: bool
    """The ride to the goal is over, the bicycle slows down."""


class WhoRides:
    """What is known of it; all methods belong to one thread.

    Attributes:
        driver: id of the policy that made the newest command; empty before the first.
        chosen: id of the policy that the controller has in charge, as far as is known.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Begin knowing nothing; `clock` is steady, s."""
        self._clock = clock
        self.driver = self.chosen = ""
        self._taken: HandOver | None = None
        self._changed: float | None = None

    @property
    def hand_over(self) -> HandOver | None:
        """Why another policy rides than the chosen one; None where none does.

        A controller that dies, or a new episode, ends it without a word: then another policy's
        commands come.
        """
        taken = self._taken
        return taken if taken is not None and taken.policy == self.driver else None

    def commanded(self, policy: str) -> None:
        """A command of this policy came."""
        if policy == self.driver:
            return
        self.driver, self._changed = policy, self._clock()
        if not self.chosen:
            self.chosen = policy

    def put_in_charge(self, policy: str) -> None:
        """The controller said that this policy is in charge."""
        self.chosen = policy

    def handed_over(self, taken: HandOver) -> None:
        """The fallback took over."""
        self._taken, self._changed = taken, None

    def handed_back(self, policy: str) -> None:
        """The chosen policy rides again."""
        self._taken, self._changed = None, None
        self.chosen = policy

    def settled(self) -> str:
        """Return the policy that rides since a moment ago and that no hand-over explains; once."""
        if self._changed is None or self._clock() - self._changed < SETTLED:
            return ""
        self._changed = None
        self.chosen = self.driver
        return self.driver
