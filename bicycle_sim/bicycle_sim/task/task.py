"""N bicycles that ride to N goals: starts, observations, rewards and ends of episodes.

The task knows neither Gymnasium nor ROS. It never resets by itself, so the caller sees the
last observation of every episode.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bicycle_common.geometry import heading_between, heading_error, wrap_angle
from bicycle_sim.plants import base, registry
from bicycle_sim.plants.base import Plant
from bicycle_sim.task import native_task
from bicycle_sim.task.native_task import DISTANCE, OBSERVED, REWARD, STEPS, TERMS, Face, NativeStep
from bicycle_sim.task.reward import reward_terms
from bicycle_sim.task.scenario import Scenario

TERM_FIELDS = ("lean_angle", "lean_rate", "lean_acceleration", "heading_error")
"""The terms of the reward, equation 20, in the order in which they are added."""

NOT_FINITE = "action holds a value that is not finite"


@dataclass(frozen=True)
class Step:
    """Result of one step of the task; arrays of shape (N,) unless said otherwise."""

    observation: np.ndarray
    """(N, 6), see OBSERVATION_FIELDS."""
    reward: np.ndarray
    """Equation 20."""
    terminated: np.ndarray
    """bool: the goal was reached in this step."""
    truncated: np.ndarray
    """bool: the step limit was reached, the goal not."""
    fallen: np.ndarray
    """bool: the bicycle lies; its state is frozen and its reward repeats (row 25)."""
    terms: dict[str, np.ndarray]
    """The reward by named term."""
    distance: np.ndarray
    """m from each rear contact to its goal."""


def draw_starts(
    scenario: Scenario, count: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw places (count, 2) m, headings (count,) rad and goals (count, 2) m."""
    start = scenario.start.draw(count, rng)
    goal = scenario.goal.draw(count, rng)
    turn = rng.uniform(-scenario.heading_spread, scenario.heading_spread, count)
    if scenario.facing_away:
        turn = turn + heading_between(goal[:, 0], goal[:, 1], start[:, 0], start[:, 1])
    heading: np.ndarray = wrap_angle(turn)
    return start, heading, goal


class BicycleTask:
    """N independent bicycles on one scenario.

    `state`, `goal_x`, `goal_y`, `steps` and `fallen` may be read at any time; tests and
    disturbances may also write to them between steps.
    """

    def __init__(
        self,
        scenario: Scenario,
        plant: Plant[Any] | None = None,
        count: int = 1,
        rng: np.random.Generator | None = None,
        native: bool = True,
    ) -> None:
        """Place `count` bicycles at their first start.

        Args:
            scenario: starts, goals, limits and ends.
            plant: the bicycles; the paper's by default. Actions that it has no use for get a
                limit of zero.
            count: N.
            rng: source of starts, goals and displacement noise; unseeded by default.
            native: True if the whole step may be made by `native_task`, with the same bits,
                where it was built and knows the plant.

        Raises:
            ValueError: when `count` is below 1.
        """
        if count < 1:
            raise ValueError(f"a task needs at least one bicycle, not {count}")
        self.plant = plant if plant is not None else registry.default()
        self.scenario = scenario.suited(self.plant.input_names)
        self.count = count
        self.rng = rng if rng is not None else np.random.default_rng()
        self.noise_rngs: Sequence[np.random.Generator | None] | None = None
        """Sources of displacement noise in place of `rng`, one a bicycle; None for no noise."""
        self._native = native_task.stepper(self.scenario, self.plant) if native else None
        self._state: Any = None
        self.steps = np.zeros(count, dtype=np.int64)
        self.fallen = np.zeros(count, dtype=bool)
        self.goal_x = np.zeros(count)
        self.goal_y = np.zeros(count)
        self._frozen_reward = np.zeros(count)
        zero = np.zeros(count)
        self.state = self.plant.initial(zero, zero, zero, zero + 1.0)
        self.reset()

    @property
    def state(self) -> Any:
        """The bicycles as they are, of the plant's `state_type`."""
        if self._state is None:
            assert self._native is not None
            self._state = self._native.state()
        return self._state

    @state.setter
    def state(self, state: Any) -> None:
        self._state = state

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Draw new starts, headings and goals for the bicycles of `mask` (N,), or for all."""
        mask = np.ones(self.count, dtype=bool) if mask is None else mask
        number = int(mask.sum())
        if number == 0:
            return
        start, heading, goal = draw_starts(self.scenario, number, self.rng)
        self.place(mask, start[:, 0], start[:, 1], heading, goal[:, 0], goal[:, 1])

    def place(
        self,
        mask: np.ndarray,
        rear_x: np.ndarray,
        rear_y: np.ndarray,
        heading: np.ndarray,
        goal_x: np.ndarray,
        goal_y: np.ndarray,
        speed: np.ndarray | None = None,
    ) -> None:
        """Put the M bicycles of `mask` (N,) upright at (M,) places with (M,) goals; m, rad, m/s.

        The scenario's start speed by default.
        """
        if speed is None:
            speed = np.full(len(rear_x), self.scenario.start_speed)
        placed = np.flatnonzero(mask)
        fresh = self.plant.take(mask).initial(rear_x, rear_y, heading, speed)
        self.state = base.put(self.state, placed, fresh)
        self.goal_x[placed] = goal_x
        self.goal_y[placed] = goal_y
        self.steps[placed] = 0
        # New arrays: the last Step still holds the old ones.
        self.fallen = self.fallen & ~mask
        self._frozen_reward = np.where(mask, 0.0, self._frozen_reward)

    def keep(self, mask: np.ndarray) -> None:
        """Go on with the bicycles of `mask` (N,) only; N becomes their number."""
        self.state = base.take(self.state, mask)
        self.plant = self.plant.take(mask)
        for name in ("goal_x", "goal_y", "steps", "fallen", "_frozen_reward"):
            setattr(self, name, getattr(self, name)[mask])
        self.count = int(mask.sum())

    def step(self, action: np.ndarray) -> Step:
        """Apply one action to every bicycle.

        Args:
            action: (N, 3) in physical units, see ACTION_FIELDS; clipped to the limits.

        Raises:
            ValueError: when the shape is not (N, 3) or a value is not finite.
        """
        action = np.asarray(action, dtype=np.float64)
        if action.shape != (self.count, 3):
            raise ValueError(f"action must have shape ({self.count}, 3), not {action.shape}")
        noisy = self.plant.displacement_noise > 0
        if (noisy or self._native is None) and not np.isfinite(action).all():
            raise ValueError(NOT_FINITE)
        noise = self._draw_noise() if noisy else None
        if self._native is None:
            return self._step(action, noise)
        if not self._native.step(self, self._state, action, noise):
            raise ValueError(NOT_FINITE)
        self._follow(self._native)
        return self._outcome_of(self._native)

    def scale(self, face: Face) -> bool:
        """Prepare `advance`; return False where the step is not compiled."""
        if self._native is not None:
            state = self.state
            self._native = native_task.stepper(self.scenario, self.plant, face)
            self.state = state
        return self._native is not None

    def advance(self, shares: np.ndarray) -> NativeStep:
        """Make a `step` from an environment's actions (N, k), after `scale`.

        Returns:
            The stepper, which has the results and the scaled observations.

        Raises:
            ValueError: when a value is not finite.
        """
        native = self._native
        assert native is not None
        noise = None
        if self.plant.displacement_noise > 0:
            if not np.isfinite(shares).all():
                raise ValueError(NOT_FINITE)
            noise = self._draw_noise()
        if not native.step_shares(self, self._state, shares, noise):
            raise ValueError(NOT_FINITE)
        self._follow(native)
        return native

    def advanced(self) -> Step:
        """Return the result of the last `advance` as `step` does."""
        assert self._native is not None
        return self._outcome_of(self._native)

    def _draw_noise(self) -> np.ndarray:
        """Draw the noise of every bicycle's displacement, (N,) m."""
        spread = self.plant.displacement_noise
        if self.noise_rngs is None:
            return self.rng.uniform(-spread, spread, self.count)
        draws = (0.0 if rng is None else rng.uniform(-spread, spread) for rng in self.noise_rngs)
        return np.fromiter(draws, float, self.count)

    def _follow(self, native: NativeStep) -> None:
        """Take over the arrays that a compiled step made."""
        self._state = None
        self.steps = native.wholes[STEPS]
        self.fallen = native.ends[2]
        self._frozen_reward = native.result[REWARD]
        native.follow(self)

    def _outcome_of(self, native: NativeStep) -> Step:
        """Return the last compiled step."""
        result, ends = native.result, native.ends
        return Step(
            result[OBSERVED:REWARD].T,
            self._frozen_reward,
            ends[0],
            ends[1],
            self.fallen,
            dict(zip(TERM_FIELDS, result[TERMS:DISTANCE], strict=True)),
            result[DISTANCE],
        )

    def _step(self, action: np.ndarray, noise: np.ndarray | None) -> Step:
        """Make one step in numpy, the reference of `native_task`."""
        state, limits = self.state, self.scenario.action_limits
        clipped = np.minimum(np.maximum(action, -limits), limits)
        # Column by column, so that the dynamics works on contiguous arrays.
        torque, displacement, pedal = np.ascontiguousarray(clipped.T)
        if noise is not None:
            displacement = displacement + noise
        moved = self.plant.step(state, torque, displacement, pedal, self.scenario.speed_limits)
        was_fallen = self.fallen
        self.state = moved = base.where(was_fallen, state, moved) if was_fallen.any() else moved
        self.steps = self.steps + 1
        self.fallen = was_fallen | self.plant.fallen(moved, self.scenario.fall_angle)
        return self._outcome(was_fallen)

    def _outcome(self, was_fallen: np.ndarray) -> Step:
        """Reward and ends of the step just made; a fallen bicycle's last reward repeats."""
        observation, distance = self.observation(), self.goal_distance()
        error = observation[:, 5]
        s = self.state
        terms = reward_terms(
            s.lean_angle, s.lean_rate, s.lean_acceleration, error, self.scenario.reward
        )
        fresh = terms["lean_angle"] + terms["lean_rate"] + terms["lean_acceleration"]
        reward = np.where(was_fallen, self._frozen_reward, fresh + terms["heading_error"])
        self._frozen_reward = reward
        terminated = ~self.fallen & (distance <= self.scenario.goal_radius)
        truncated = ~terminated & (self.steps >= self.scenario.max_steps)
        return Step(observation, reward, terminated, truncated, self.fallen, terms, distance)

    def observation(self) -> np.ndarray:
        """Return the six states of every bicycle, (N, 6), see OBSERVATION_FIELDS."""
        s = self.state
        error = heading_error(s.heading, s.rear_x, s.rear_y, self.goal_x, self.goal_y)
        columns = (
            s.steer_angle,
            s.steer_rate,
            s.lean_angle,
            s.lean_rate,
            s.lean_acceleration,
            error,
        )
        # One column after the other in memory, which is how they come and how an actor takes them.
        return np.array(columns).T

    def goal_distance(self) -> np.ndarray:
        """Return the distance (N,), m, from each rear contact to its goal (row 26)."""
        x, y = self.goal_x - self.state.rear_x, self.goal_y - self.state.rear_y
        return np.sqrt(x * x + y * y)

    def snapshot(self) -> Any:
        """Return a copy of every bicycle's state."""
        return base.copy(self.state)
