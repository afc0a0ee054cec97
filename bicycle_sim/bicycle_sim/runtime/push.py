"""Pushes from the side: what is let in, and in which step it acts.

A push adds to the lean rate of the state that a step begins with, as a blow of that angular
impulse would. It is told apart from the state, so that a bag shows it and a ride under pushes
can be computed again to the bit.
"""

from __future__ import annotations

import math

LARGEST_PUSH = 2.0
"""rad/s, of all pushes in one step together; a bicycle at rest falls from some 1.1 rad/s on."""


class PushGate:
    """Holds pushes until the next step is made."""

    def __init__(self, largest: float = LARGEST_PUSH) -> None:
        """Begin with none; `largest` in rad/s bounds their sum."""
        self._largest = largest
        self._waiting = 0.0

    def add(self, lean_rate: float) -> None:
        """Let one in, rad/s, positive to the left.

        Raises:
            ValueError: when it is not finite, or too large together with those that wait.
        """
        if not math.isfinite(lean_rate):
            raise ValueError(f"its lean rate is {lean_rate}: send a finite number")
        total = self._waiting + lean_rate
        if abs(total) > self._largest:
            others = ", with those that wait for the same step" if self._waiting else ""
            raise ValueError(
                f"its lean rate {lean_rate:g} rad/s is beyond {self._largest:g} rad/s{others}: "
                "push less"
            )
        self._waiting = total

    def take(self) -> float:
        """The sum of those that waited, rad/s; none waits any more."""
        taken, self._waiting = self._waiting, 0.0
        return taken
