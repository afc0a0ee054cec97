"""When the simulator steps, and under which command: real time, lock-step, pause and watchdog.

A bicycle is held at its start until the first valid command of the episode. From then on

- in real time every step falls due by a fixed schedule and applies the newest command;
- in lock-step every step is made when the command that answers the present state arrives.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

from bicycle_common.types import BicycleState, Command, InitialPose, Push, Transition
from bicycle_common.validation import require
from bicycle_sim.runtime.command_validator import CommandValidator
from bicycle_sim.runtime.pacing import Pacer, StepTiming
from bicycle_sim.runtime.push import PushGate
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.runtime.transitions import TransitionLog

RELEASE = 0.25
"""s of silence, at least, after which a controller gives way to another."""

SHORTEST_WATCHDOG = 4
"""Steps: with less, the ordinary delay of an answer would set the watchdog off."""

ROUNDING = 1e-6
"""s."""


@dataclass(frozen=True)
class LoopOptions:
    """How the loop is paced and what it does without commands.

    Raises:
        ValueError: on an unknown choice or a number out of range.
    """

    pace: str = "realtime"
    """`realtime` or `lockstep`."""
    real_time_factor: float = 1.0
    """Simulated seconds in one second of the clock; real time only."""
    watchdog_timeout: float = 0.25
    """Simulated s that a command may be held before `on_timeout`; zero is for ever.
    Real time only."""
    on_timeout: str = "zero"
    """`zero` rides on without input, `pause` holds the bicycle until the next command."""

    def __post_init__(self) -> None:
        require(
            self.pace in ("realtime", "lockstep"),
            f"pace must be realtime or lockstep, not {self.pace!r}",
        )
        require(
            self.on_timeout in ("zero", "pause"),
            f"on_timeout must be zero or pause, not {self.on_timeout!r}",
        )
        require(
            math.isfinite(self.watchdog_timeout) and self.watchdog_timeout >= 0,
            f"watchdog_timeout must be zero or more seconds, not {self.watchdog_timeout!r}",
        )


@dataclass(frozen=True)
class StepResult:
    """One step that the loop made."""

    snapshot: BicycleState
    transitions: list[Transition]
    """Those that are complete now."""
    timing: StepTiming
    """In lock-step the lateness is NaN."""
    latency: float
    """s from publishing the state before to the command that answered it; NaN without one."""
    push: Push | None = None
    """That acted in it."""


class Loop:
    """One bicycle, its command gate and its schedule.

    Attributes:
        held: waits for a command, at the start or after a watchdog's pause.
        paused: somebody paused it.
        starved: the last step was made without a valid command.
    """

    def __init__(
        self,
        simulator: Simulator,
        options: LoopOptions,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """Make the loop; `reset` begins the first episode.

        Args:
            simulator: the bicycle.
            options: pace and watchdog.
            clock: monotonic, ns.
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
        self.gate = CommandValidator(
            simulator.scenario.action_limits,
            release=max(self.patience, RELEASE),
            max_age=math.ceil((options.watchdog_timeout or 1e6) / simulator.time_step),
            clock=lambda: clock() * 1e-9,
        )
        self.held = True
        self.paused = False
        self.starved = False
        self.total_steps = 0
        self._clock = clock
        self._log = TransitionLog(simulator.scenario)
        self._pushes = PushGate()
        self._published = clock()
        self._latency = math.nan
        self._last_step: int | None = None

    @property
    def lockstep(self) -> bool:
        """Whether steps wait for commands."""
        return self.options.pace == "lockstep"

    @property
    def snapshot(self) -> BicycleState:
        """The present state."""
        return self.simulator.snapshot

    @property
    def riding(self) -> bool:
        """Whether steps are being made."""
        return not (self.held or self.paused or self.snapshot.fallen)

    def reset(self, start: InitialPose | None, seed: int | None) -> list[Transition]:
        """Begin a new episode; see `Simulator.reset`, which may raise ValueError.

        Returns:
            The last transition of the old one, if it was still open.
        """
        snapshot = self.simulator.reset(start, seed)
        self.gate.begin(snapshot.episode)
        self.held, self.starved = True, False
        self._last_step = None
        self._latency = math.nan
        self._pushes.take()
        return self._log.cut()

    def close(self) -> list[Transition]:
        """The last transition, if it is still open."""
        return self._log.cut()

    def published(self) -> None:
        """Note that the present state is published now, for the first time or again."""
        self._published = self._clock()

    def receive(self, command: Command) -> tuple[str, StepResult | None]:
        """Take in a command.

        Returns:
            A line to warn with, or nothing; and in lock-step the step that it led to.
        """
        step = self.snapshot.step
        decision = self.gate.decide(command, step)
        if not decision.accepted:
            return decision.warning, None
        if command.step == step:
            self._latency = (self._clock() - self._published) * 1e-9
        if self.held:
            self.held = False
            self.pacer.start()
        return "", self._answer() if self.lockstep else None

    def pause(self, paused: bool) -> StepResult | None:
        """Stop or go on; in lock-step an answer that came meanwhile is a step now."""
        going_on = self.paused and not paused
        self.paused = paused
        if not going_on:
            return None
        self.gate.keep_alive()
        self.pacer.start()
        return self._answer() if self.lockstep else None

    def push(self, lean_rate: float) -> None:
        """Push in the next step, whenever that is; rad/s, positive to the left.

        Raises:
            ValueError: when `PushGate` does not let it in, or the bicycle lies.
        """
        if self.snapshot.fallen:
            raise ValueError("the bicycle lies: call bicycle/reset first")
        self._pushes.add(lean_rate)

    def tick(self) -> StepResult | None:
        """In real time: make the step that is due, unless the bicycle is held, paused or down."""
        if not self.riding:
            return None
        timing = self.pacer.tick()
        # A command may rule no step that would end after the watchdog's time.
        ends = self.gate.silence() + self.pacer.period_ns * 1e-9
        silent = self.patience > 0 and ends > self.patience + ROUNDING
        if silent and self.options.on_timeout == "pause":
            self.held, self.starved = True, True
            return None
        self.starved = silent
        return self._make(None if silent else self.gate.newest, timing)

    def single_step(self) -> StepResult | None:
        """One step while paused, under the command that answers this state or zero input."""
        if not self.paused or self.snapshot.fallen:
            return None
        newest = self.gate.newest
        fresh = newest is not None and newest.step == self.snapshot.step
        self.held = False
        return self._make(newest if fresh else None, StepTiming(math.nan, math.nan))

    def _answer(self) -> StepResult | None:
        """In lock-step: the step under the answer to the present state, if there is one."""
        newest = self.gate.newest
        if not self.riding or newest is None or newest.step != self.snapshot.step:
            return None
        now = self._clock()
        since = math.nan if self._last_step is None else (now - self._last_step) * 1e-9
        self._last_step = now
        self.starved = False
        return self._make(newest, StepTiming(since, math.nan))

    def _make(self, command: Command | None, timing: StepTiming) -> StepResult:
        """Make one step."""
        before, lean_rate = self.snapshot, self._pushes.take()
        push = Push(before.episode, before.step, lean_rate) if lean_rate else None
        after = self.simulator.step(command, lean_rate)
        self.total_steps += 1
        transitions = self._log.add(before, after, command)
        latency, self._latency = self._latency, math.nan
        return StepResult(after, transitions, timing, latency, push)
