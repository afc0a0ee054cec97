"""Loop of the simulator: time and command of each step.

A bicycle waits at its start for the first valid command of the episode. After that

- in real time every step is due by a fixed schedule and applies the newest command;
- in lock-step every step is made when the command that answers the current state arrives.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

from bicycle_common.types import AppliedCommand, BicycleState, Command, InitialPose, Push
from bicycle_common.validation import require
from bicycle_sim.runtime.command_validator import CommandValidator
from bicycle_sim.runtime.pacing import Pacer, StepTiming
from bicycle_sim.runtime.push import PushGate
from bicycle_sim.runtime.simulator import Simulator

RELEASE = 0.25
"""Shortest silence after which a controller gives way to another (s)."""

SHORTEST_WATCHDOG = 4
"""Fewest steps of the watchdog: fewer, and the normal delay of an answer would trigger it."""

WITHOUT_COMMANDS = {
    "zero": "zero input",
    "steer_into_lean": "torque into its lean",
    "pause": "held",
}
"""Input of a bicycle without commands, in words for the log."""
ON_TIMEOUT = tuple(WITHOUT_COMMANDS)

ROUNDING = 1e-6
"""Tolerance of rounding in time comparisons (s)."""


@dataclass(frozen=True)
class LoopOptions:
    """Pace of the loop, and behaviour without commands.

    Raises:
        ValueError: on an unknown choice or a number out of range.
    """

    pace: str = "realtime"
    """`realtime` or `lockstep`."""
    real_time_factor: float = 1.0
    """Simulated seconds per second of the clock; real time only."""
    watchdog_timeout: float = 0.25
    """Simulated time that a command may be held before `on_timeout`, s; zero disables the
    watchdog. Real time only."""
    on_timeout: str = "zero"
    """`zero` continues without input and `steer_into_lean` by that law, whose gain is the
    scenario's; `pause` stops the bicycle until the next command."""

    def __post_init__(self) -> None:
        require(
            self.pace in ("realtime", "lockstep"),
            f"pace must be realtime or lockstep, not {self.pace!r}",
        )
        require(
            self.on_timeout in ON_TIMEOUT,
            f"on_timeout must be zero, steer_into_lean or pause, not {self.on_timeout!r}",
        )
        require(
            math.isfinite(self.watchdog_timeout) and self.watchdog_timeout >= 0,
            f"watchdog_timeout must be zero or more seconds, not {self.watchdog_timeout!r}",
        )


@dataclass(frozen=True)
class StepResult:
    """A step that the loop has made."""

    snapshot: BicycleState
    applied: AppliedCommand
    """Input of the step."""
    timing: StepTiming
    """Punctuality of the step; its lateness is NaN in lock-step."""
    latency: float
    """Time from publishing the previous state to the command that answered it, s; or NaN."""
    push: Push | None = None
    """Push that acted in this step."""


class Loop:
    """One bicycle, its command validator and its schedule.

    Attributes:
        waiting: True while it waits for a command, at the start or after a watchdog's pause.
        paused: True while a user's pause lasts.
        timed_out: True if the last step was made without a valid command.
    """

    def __init__(
        self,
        simulator: Simulator,
        options: LoopOptions,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """Create the loop; `reset` begins the first episode.

        Args:
            simulator: the bicycle.
            options: pace and watchdog.
            clock: monotonic clock, ns.
        """
        self.simulator = simulator
        self.options = options
        shortest = SHORTEST_WATCHDOG * simulator.time_step
        require(
            options.watchdog_timeout == 0 or options.watchdog_timeout >= shortest,
            f"watchdog_timeout must be 0 for never, or {shortest:g} s or more, not "
            f"{options.watchdog_timeout:g}",
        )
        self.pacer = Pacer(simulator.time_step, options.real_time_factor, clock)
        self.patience = options.watchdog_timeout / options.real_time_factor
        self.validator = CommandValidator(
            simulator.scenario.action_limits,
            release=max(self.patience, RELEASE),
            max_age=math.ceil((options.watchdog_timeout or 1e6) / simulator.time_step),
            clock=lambda: clock() * 1e-9,
        )
        self.waiting = True
        self.paused = False
        self.timed_out = False
        self.total_steps = 0
        self._clock = clock
        self._pushes = PushGate()
        self._published = clock()
        self._latency = math.nan
        self._last_step: int | None = None

    @property
    def lockstep(self) -> bool:
        """True if steps wait for commands."""
        return self.options.pace == "lockstep"

    @property
    def snapshot(self) -> BicycleState:
        """Current state."""
        return self.simulator.snapshot

    @property
    def riding(self) -> bool:
        """True if steps are being made."""
        return not (self.waiting or self.paused or self.snapshot.fallen)

    def reset(self, start: InitialPose | None, seed: int | None) -> None:
        """Begin a new episode; see `Simulator.reset`, which may raise ValueError."""
        snapshot = self.simulator.reset(start, seed)
        self.validator.begin(snapshot.episode)
        self.waiting, self.timed_out = True, False
        self._last_step = None
        self._latency = math.nan
        self._pushes.take()

    def published(self) -> None:
        """Note that the current state is published now, for the first time or again."""
        self._published = self._clock()

    def receive(self, command: Command) -> tuple[str, StepResult | None]:
        """Take in a command.

        Returns:
            A warning, or an empty text; and in lock-step the step that the command led to.
        """
        step = self.snapshot.step
        decision = self.validator.decide(command, step)
        if not decision.accepted:
            return decision.warning, None
        if command.step == step:
            self._latency = (self._clock() - self._published) * 1e-9
        if self.waiting:
            self.waiting = False
            self.pacer.start()
        return "", self._answer() if self.lockstep else None

    def pause(self, paused: bool) -> StepResult | None:
        """Pause or resume; in lock-step an answer from during the pause makes its step now."""
        going_on = self.paused and not paused
        self.paused = paused
        if not going_on:
            return None
        self.validator.keep_alive()
        self.pacer.start()
        return self._answer() if self.lockstep else None

    def push(self, lean_rate: float) -> None:
        """Push in the next step, whenever that is; rad/s, positive to the left.

        Raises:
            ValueError: if `PushGate` rejects it, or the bicycle has fallen.
        """
        if self.snapshot.fallen:
            raise ValueError("the bicycle lies: call bicycle/reset first")
        self._pushes.add(lean_rate)

    def tick(self) -> StepResult | None:
        """Make the due step in real time, unless the bicycle is waiting, paused or fallen."""
        if not self.riding:
            return None
        timing = self.pacer.tick()
        # Do not hold a command if the step would end after the watchdog timeout.
        ends = self.validator.silence() + self.pacer.period_ns * 1e-9
        silent = self.patience > 0 and ends > self.patience + ROUNDING
        if silent and self.options.on_timeout == "pause":
            self.waiting, self.timed_out = True, True
            return None
        self.timed_out = silent
        return self._make(None if silent else self.validator.newest, timing)

    def single_step(self) -> StepResult | None:
        """Make one step while paused, under the command that answers this state or zero input."""
        if not self.paused or self.snapshot.fallen:
            return None
        newest = self.validator.newest
        fresh = newest is not None and newest.step == self.snapshot.step
        self.waiting = False
        return self._make(newest if fresh else None, StepTiming(math.nan, math.nan))

    def _answer(self) -> StepResult | None:
        """Make the step under the answer to the current state, if there is one; lock-step only."""
        newest = self.validator.newest
        if not self.riding or newest is None or newest.step != self.snapshot.step:
            return None
        now = self._clock()
        since = math.nan if self._last_step is None else (now - self._last_step) * 1e-9
        self._last_step = now
        self.timed_out = False
        return self._make(newest, StepTiming(since, math.nan))

    def _make(self, command: Command | None, timing: StepTiming) -> StepResult:
        """Make one step."""
        before, lean_rate = self.snapshot, self._pushes.take()
        push = Push(before.episode, before.step, lean_rate) if lean_rate else None
        after = self.simulator.step(command, lean_rate)
        self.total_steps += 1
        latency, self._latency = self._latency, math.nan
        return StepResult(after, self.simulator.applied, timing, latency, push)
