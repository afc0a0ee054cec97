"""Loop of a bicycle that a microcontroller moves: when its next control period begins."""

from __future__ import annotations

import math
from collections.abc import Callable

from bicycle_hardware.bench.board_simulator import BoardSimulator
from bicycle_sim.runtime.loop import Loop, StepResult
from bicycle_sim.runtime.pacing import StepTiming

PATIENCE_MS = 20
"""Longest wait within one call (ms), so that services are answered."""


class BoardLoop(Loop):
    """Schedule of the periods: by the clock in real time, after each answer in lock-step."""

    simulator: BoardSimulator
    on_begin: Callable[[], None] = staticmethod(lambda: None)
    """Called when a period begins, before the microcontroller runs."""

    @property
    def riding(self) -> bool:
        """True if periods pass."""
        return not (self.paused or self.snapshot.fallen)

    def push(self, lean_rate: float) -> None:
        """Push in the next period.

        Raises:
            ValueError: as `Loop.push`, or while the bicycle is held.
        """
        if self.simulator.held:
            raise ValueError("the bicycle is held upright until bicycle/arm arms it")
        super().push(lean_rate)

    def tick(self) -> StepResult | None:
        """Let the next period pass, if it may."""
        if not self.riding:
            return None
        if not self.simulator.is_awaited(PATIENCE_MS if self.lockstep else 0, self.lockstep):
            return None
        if not self.simulator.begun:
            self.pacer.start()
        self.on_begin()
        if self.lockstep:
            now = self._clock()
            since = math.nan if self._last_step is None else (now - self._last_step) * 1e-9
            self._last_step = now
            timing = StepTiming(since, math.nan)
        else:
            timing = self.pacer.tick()
        result = self._make(None, timing)
        self.waiting = self.simulator.held
        return result
