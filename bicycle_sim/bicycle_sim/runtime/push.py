"""Lateral pushes: validation, and the step in which they act.

A push adds to the lean rate of the state with which a step begins, as a blow of that angular
impulse would. It is recorded separately from the state, so that a bag shows it and a ride under
pushes can be recomputed to the bit.
"""

from __future__ import annotations

import math

LARGEST_PUSH = 2.0
"""Largest sum of all pushes in one step, rad/s; a bicycle at rest falls from about 1.1 rad/s."""


class PushGate:
    """Holds pushes until the next step."""

    def __init__(self, largest: float = LARGEST_PUSH) -> None:
        """Start without a push; `largest` in rad/s bounds their sum."""
        self._largest = largest
        self._waiting = 0.0

    def add(self, lean_rate: float) -> None:
        """Accept a push, rad/s, positive to the left.

        Raises:
            ValueError: if it is not finite, or too large together with the pending pushes.
        """
        if not math.isfinite(lean_rate):
            raise ValueError(f"its lean rate is {lean_rate}: send a finite number")
        total = self._waiting + lean_rate
        if abs(total) > self._largest:
            also = f" ({total:g} rad/s with those that wait for the same step)"
            rate = f"{lean_rate:g} rad/s{also if self._waiting else ''}"
            raise ValueError(f"its lean rate {rate} is beyond {self._largest:g} rad/s: push less")
        self._waiting = total

    def take(self) -> float:
        """Return the sum of the pending pushes, rad/s, and remove them."""
        taken, self._waiting = self._waiting, 0.0
        return taken
