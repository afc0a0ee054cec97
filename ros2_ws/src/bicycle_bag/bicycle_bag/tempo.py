"""The time of a replay: it can be held, stepped through and run faster or slower."""

from __future__ import annotations

import time
from collections.abc import Callable

SLICE = 0.02
"""Time between two checks for keys and services, s."""
FASTER = 1.1
"""Factor of the speed for one key press."""
SLOWEST, FASTEST = 0.01, 100.0
"""Times the rate that the replay was started with."""


class Tempo:
    """A clock that a replay goes by.

    Attributes:
        paused: True if the clock is held.
        factor: seconds of this clock in a second; 1 at first.
    """

    def __init__(self, paused: bool = False, clock: Callable[[], float] = time.monotonic) -> None:
        """Make a clock at zero; `clock` is steady, s."""
        self.paused = paused
        self.factor = 1.0
        self._clock = clock
        self._position = 0.0
        self._since = clock()
        self._steps = 0

    def restart(self) -> None:
        """Begin at zero again; a clock that is held stays so."""
        self._position = 0.0
        self._since = self._clock()

    @property
    def position(self) -> float:
        """s that have passed on this clock."""
        if self.paused:
            return self._position
        return self._position + self.factor * (self._clock() - self._since)

    def pause(self) -> None:
        """Hold the clock."""
        self._settle()
        self.paused = True

    def resume(self) -> None:
        """Let the clock go on from where it was held."""
        self._settle()
        self.paused = False
        self._steps = 0

    def toggle(self) -> None:
        """Hold the clock, or let it go on."""
        if self.paused:
            self.resume()
        else:
            self.pause()

    def step(self) -> bool:
        """Let one message pass while the clock is held; whether it is."""
        self._steps += int(self.paused)
        return self.paused

    def speed_up(self, factor: float) -> float:
        """Run so many times as fast as now, within limits; returns the new factor."""
        self._settle()
        self.factor = min(max(self.factor * factor, SLOWEST), FASTEST)
        return self.factor

    def _settle(self) -> None:
        self._position = self.position
        self._since = self._clock()

    def wait_until(self, due: float, sleep: Callable[[float], bool]) -> bool:
        """Wait for a time on this clock, or for a step while it is held.

        Args:
            due: s.
            sleep: waits for so many seconds of the steady clock, and returns whether to end.

        Returns:
            Whether the wait ended without that `sleep` wanted it to.
        """
        while True:
            if self.paused and self._steps:
                self._steps -= 1
                self._position = max(self._position, due)
                return True
            left = due - self.position
            if not self.paused and left <= 0.0:
                return True
            if sleep(SLICE if self.paused else min(SLICE, left / self.factor)):
                return False
