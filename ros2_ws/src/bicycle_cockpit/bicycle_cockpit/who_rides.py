"""Riding policy, chosen policy, and the reason if the LQR rides instead.

The controller publishes all three on separate topics: each command names its policy, the
diagnostics name the active one, and a switch says who takes over and why.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

SETTLED = 0.2
"""Time after which a change of policy is reported, unless a switch explains it (s)."""


@dataclass(frozen=True)
class HandOver:
    """The safety layer's report that the fallback rides."""

    policy: str
    """Id of the policy that rides from here on."""
    why: str
    """Reason in words."""
    since: float
    """Simulated time, s."""
    stop: bool
    """True if the ride to the goal is over and the bicycle slows down."""


class WhoRides:
    """Riding and chosen policy; all methods belong to one thread.

    Attributes:
        driver: id of the policy that made the newest command; empty before the first.
        chosen: id of the controller's active policy, as far as known.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Start without data; `clock` is steady, s."""
        self._clock = clock
        self.driver = self.chosen = ""
        self._taken: HandOver | None = None
        self._changed: float | None = None

    @property
    def hand_over(self) -> HandOver | None:
        """Return why another policy rides than the chosen one; None if none does.

        A controller's death, or a new episode, ends it without a report: then commands of another
        policy arrive.
        """
        taken = self._taken
        return taken if taken is not None and taken.policy == self.driver else None

    def commanded(self, policy: str) -> None:
        """Take in the policy of a command."""
        if policy == self.driver:
            return
        self.driver, self._changed = policy, self._clock()
        if not self.chosen:
            self.chosen = policy

    def put_in_charge(self, policy: str) -> None:
        """Take in the controller's active policy."""
        self.chosen = policy

    def handed_over(self, taken: HandOver) -> None:
        """Take in a switch to the fallback."""
        self._taken, self._changed = taken, None

    def handed_back(self, policy: str) -> None:
        """Take in a switch back to the chosen policy."""
        self._taken, self._changed = None, None
        self.chosen = policy

    def settled(self) -> str:
        """Return a newly riding policy that no switch explains, once."""
        if self._changed is None or self._clock() - self._changed < SETTLED:
            return ""
        self._changed = None
        self.chosen = self.driver
        return self.driver
