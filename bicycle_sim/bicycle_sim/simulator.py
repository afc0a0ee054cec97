"""One bicycle, step by step, that can be rebuilt to the bit from what a bag holds.

The paper's signs and symbols throughout. A bicycle is a batch of one, stepped by the same
`dynamics.step` as the thousands in training, so that what is learned there holds here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum

import numpy as np

from bicycle_sim import dynamics
from bicycle_sim.config import require
from bicycle_sim.dynamics import State
from bicycle_sim.geometry import heading_error
from bicycle_sim.parameters import Physics
from bicycle_sim.scenario import Scenario
from bicycle_sim.task import BicycleTask

Point = tuple[float, float]
"""(x, y), m."""

FARTHEST_START = 1e5
"""m: beyond this a double no longer resolves a step's motion well."""

FASTEST_START = 20.0
"""m/s: beyond this one step is half a wheelbase long."""


class Source(IntEnum):
    """Where the input of a step came from; the numbers are those of BicycleState."""

    INITIAL = 0
    FRESH = 1
    HELD = 2
    ZERO = 3


@dataclass(frozen=True)
class Command:
    """What a controller wants done in the step after the state it answers."""

    episode: int
    step: int
    torque: float
    """N m, positive steers left (T)."""
    displacement: float
    """m, positive to the left (d)."""
    pedal_force: float
    """N (F)."""
    goal: Point | None = None
    """m, the goal that the command pursues."""
    goal_id: int = 0
    controller: str = ""
    policy: str = ""

    @property
    def action(self) -> tuple[float, float, float]:
        """(T, d, F) in N m, m, N."""
        return self.torque, self.displacement, self.pedal_force


@dataclass(frozen=True)
class Start:
    """Where an episode begins: upright, handlebar straight.

    Raises:
        ValueError: on a value that is not finite or beyond reason.
    """

    x: float
    """m, rear contact (x_b)."""
    y: float
    """m, rear contact (y_b)."""
    heading: float
    """rad (psi)."""
    speed: float
    """m/s (v)."""

    def __post_init__(self) -> None:
        for name in ("x", "y", "heading", "speed"):
            value = getattr(self, name)
            require(math.isfinite(value), f"the start's {name} must be finite, not {value!r}")
        require(
            max(abs(self.x), abs(self.y)) <= FARTHEST_START,
            f"the start ({self.x:g}, {self.y:g}) must lie within {FARTHEST_START:g} m of 0, 0",
        )
        require(
            0 <= self.speed <= FASTEST_START,
            f"the start's speed must be 0 to {FASTEST_START:g} m/s, not {self.speed:g}",
        )


@dataclass(frozen=True)
class Snapshot:
    """The bicycle after one step, as plain numbers in the paper's signs."""

    episode: int
    step: int
    lean_angle: float
    """rad, positive to the left (omega)."""
    lean_rate: float
    """rad/s (omega dot)."""
    lean_acceleration: float
    """rad/s^2 (omega double dot)."""
    steer_angle: float
    """rad, positive to the left (theta)."""
    steer_rate: float
    """rad/s (theta dot)."""
    heading: float
    """rad from +y, counter-clockwise (psi)."""
    front_x: float
    """m (x_f)."""
    front_y: float
    """m (y_f)."""
    rear_x: float
    """m (x_b)."""
    rear_y: float
    """m (y_b)."""
    speed: float
    """m/s (v)."""
    fallen: bool = False
    goal: Point | None = None
    """m, the goal that the applied command pursued."""
    heading_error: float = math.nan
    """rad, positive when that goal lies to the right (psi_g); NaN without a goal."""
    goal_distance: float = math.nan
    """m from the rear contact; NaN without a goal."""
    command_source: Source = Source.INITIAL
    command_step: int = -1
    """Step answered by the applied command, -1 for none."""
    controller: str = ""
    """Who sent the applied command; empty for none."""
    action: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0), compare=False)
    """(T, d, F) as commanded, N m, m, N. A state message does not carry it."""


class Simulator:
    """One bicycle on one scenario.

    Episodes are counted from 1 and steps from 0. A fallen bicycle stays as it lies: its steps
    count on, its state does not change (errata row 25).
    """

    def __init__(self, scenario: Scenario, physics: Physics | None = None, seed: int = 0) -> None:
        """Make a simulator whose first episode is still to be started by `reset`.

        Args:
            scenario: limits, start speed, goal radius and fall angle.
            physics: constants and corrections; faithful by default.
            seed: of the first episode, unless `reset` names another; not negative.
        """
        self.scenario = scenario
        self.physics = physics or Physics()
        self.seed = _checked_seed(seed) - 1
        self._state: State
        self._noise: np.random.Generator
        self.snapshot = self._place(Start(0.0, 0.0, 0.0, scenario.start_speed), episode=0)

    @property
    def time_step(self) -> float:
        """s (dt)."""
        return self.physics.constants.time_step

    def reset(self, start: Start | None = None, seed: int | None = None) -> Snapshot:
        """Begin the next episode.

        Args:
            start: where; None draws one from the scenario with this episode's seed.
            seed: of the episode; None takes the one after the last episode's.

        Returns:
            The state at step 0.

        Raises:
            ValueError: on a negative seed or a speed outside the scenario's limits.
        """
        seed = self.seed + 1 if seed is None else _checked_seed(seed)
        start = self._draw(seed) if start is None else start
        limits = self.scenario.speed_limits
        if limits is not None and not limits[0] <= start.speed <= limits[1]:
            raise ValueError(
                f"the start's speed {start.speed:g} m/s is outside the scenario's limits "
                f"{limits[0]:g} to {limits[1]:g} m/s"
            )
        self.seed = seed
        self.snapshot = self._place(start, self.snapshot.episode + 1)
        return self.snapshot

    @classmethod
    def restore(
        cls, snapshot: Snapshot, scenario: Scenario, physics: Physics, seed: int
    ) -> Simulator:
        """A simulator that goes on from `snapshot` as the one did that made it, to the bit.

        Args:
            snapshot: any state of an episode, as a message gives it.
            scenario: of that episode.
            physics: of that episode.
            seed: of that episode, so that displacement noise goes on where it was.
        """
        made = cls(scenario, physics, seed)
        made.seed = seed
        made.snapshot = snapshot
        made._state = State(
            **{item.name: np.array([getattr(snapshot, item.name)]) for item in fields(State)}
        )
        made._noise = _noise(seed, snapshot.step)
        return made

    def step(self, command: Command | None, push: float = 0.0) -> Snapshot:
        """One time step under a command, or under zero input.

        Args:
            command: newest valid one; applied as it is, so check it with `CommandGate` first.
            push: rad/s added to the lean rate before the step (`push.PushGate` checks it).

        Returns:
            The state dt later.
        """
        before = self.snapshot
        if not before.fallen:
            torque, displacement, pedal = command.action if command else (0.0, 0.0, 0.0)
            spread = self.physics.displacement_noise
            if spread > 0:
                displacement += spread * (2.0 * float(self._noise.random()) - 1.0)
            begun = self._state
            if push:
                begun = replace(begun, lean_rate=begun.lean_rate + push)
            self._state = dynamics.step(
                begun,
                np.array([torque]),
                np.array([displacement]),
                np.array([pedal]),
                self.physics,
                self.scenario.speed_limits,
            )
        self.snapshot = self._observe(before.episode, before.step + 1, command)
        return self.snapshot

    def _observe(self, episode: int, step: int, command: Command | None) -> Snapshot:
        """The present state as plain numbers, with the goal of the command that led to it."""
        state = self._state
        numbers = {item.name: float(getattr(state, item.name)[0]) for item in fields(State)}
        goal = command.goal if command else None
        error, distance = goal_bearing(numbers, goal)
        if step == 0:
            source = Source.INITIAL
        elif command is None:
            source = Source.ZERO
        else:
            source = Source.FRESH if command.step == step - 1 else Source.HELD
        lies = dynamics.fallen(numbers["lean_angle"], self.scenario.fall_angle)
        return Snapshot(
            episode=episode,
            step=step,
            **numbers,
            fallen=bool(lies),
            goal=goal,
            heading_error=error,
            goal_distance=distance,
            command_source=source,
            command_step=command.step if command else -1,
            controller=command.controller if command else "",
            action=command.action if command else (0.0, 0.0, 0.0),
        )

    def _place(self, start: Start, episode: int) -> Snapshot:
        """Put the bicycle at `start`."""
        where = (np.array([start.x]), np.array([start.y]), np.array([start.heading]))
        speed = np.array([start.speed])
        self._state = dynamics.upright(*where, speed, self.physics.constants)
        self._noise = _noise(self.seed)
        return self._observe(episode, 0, None)

    def _draw(self, seed: int) -> Start:
        """A start of the scenario's distribution, as the task draws it."""
        drawn = BicycleTask(self.scenario, self.physics, rng=np.random.default_rng([seed, 1]))
        state = drawn.state
        return Start(
            x=float(state.rear_x[0]),
            y=float(state.rear_y[0]),
            heading=float(state.heading[0]),
            speed=self.scenario.start_speed,
        )


def goal_bearing(numbers: dict[str, float], goal: Point | None) -> tuple[float, float]:
    """Heading error psi_g (rad) and distance (m) of a goal from a state; NaN without one."""
    if goal is None:
        return math.nan, math.nan
    x, y = numbers["rear_x"], numbers["rear_y"]
    error = heading_error(np.array([numbers["heading"]]), np.array([x]), np.array([y]), *goal)
    return float(error[0]), float(np.hypot(goal[0] - x, goal[1] - y))


def _checked_seed(seed: int) -> int:
    """The seed.

    Raises:
        ValueError: when it is negative.
    """
    require(seed >= 0, f"a seed must be zero or more, not {seed}")
    return seed


def _noise(seed: int, drawn: int = 0) -> np.random.Generator:
    """Source of displacement noise, one draw a step, after so many draws."""
    bits = np.random.PCG64([max(seed, 0), 0])
    bits.advance(drawn)
    return np.random.Generator(bits)
