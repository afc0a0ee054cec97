"""Schedule without drift or bursts of catching up, on any monotonic clock."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

from bicycle_common.validation import require


@dataclass(frozen=True)
class StepTiming:
    """Punctuality of one step."""

    period: float
    """Time since the previous step, s; NaN for the first."""
    lateness: float
    """Delay after the due time, s."""


class Pacer:
    """Schedules steps at whole multiples of a period after `start`.

    A step that begins more than half a period late counts as late. Periods that have passed
    entirely are dropped and counted, never caught up.

    Raises:
        ValueError: on a time step or a factor that is not finite and above zero.
    """

    def __init__(
        self,
        time_step: float,
        real_time_factor: float = 1.0,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """Create a schedule; `start` begins it.

        Args:
            time_step: simulated duration of one step (dt), s.
            real_time_factor: simulated seconds per second of `clock`.
            clock: monotonic clock, ns.
        """
        for name, value in (("time_step", time_step), ("real_time_factor", real_time_factor)):
            require(
                math.isfinite(value) and value > 0,
                f"{name} must be a finite number above zero, not {value!r}",
            )
        self.period_ns = max(1, round(1e9 * time_step / real_time_factor))
        self.late = 0
        self.dropped = 0
        self._clock = clock
        self._due = 0
        self._last: int | None = None

    def start(self) -> None:
        """Make the first step due one period from now; keep the counts."""
        self._due = self._clock() + self.period_ns
        self._last = None

    def remaining(self) -> float:
        """Return the time until the next step is due, s; negative if it is late."""
        return (self._due - self._clock()) * 1e-9

    def tick(self) -> StepTiming:
        """Note that a step begins now, and schedule the next."""
        now = self._clock()
        behind = now - self._due
        period = math.nan if self._last is None else (now - self._last) * 1e-9
        if behind > self.period_ns // 2:
            self.late += 1
        missed = max(0, behind // self.period_ns)
        self.dropped += missed
        self._due += (1 + missed) * self.period_ns
        self._last = now
        return StepTiming(period, behind * 1e-9)
