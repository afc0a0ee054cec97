"""Ride a controller from many starts at once and record each ride's result."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from bicycle_controller.control.controller import Controller
from bicycle_common.geometry import wrap_angle
from bicycle_common.observation import OBSERVATION_FIELDS
from bicycle_common.progress import ProgressBar
from bicycle_common.validation import require
from bicycle_controller.control.riding import Riding
from bicycle_sim.plants.base import Plant
from bicycle_sim.task.scenario import Scenario
from bicycle_sim.task.task import BicycleTask, Step

CHUNK = 16384
"""Number of rides simulated together, which bounds the memory of a million rides."""
MOST = 10_000_000
"""Largest number of rides of one evaluation, whose figures are kept in memory."""
LARGEST = 1e6
"""Largest value of any disturbance, in its own unit."""
STARTS, NOISE = 0, 1
"""Keys of the random streams; all controllers get the same starts and the same kind of noise."""


@dataclass(frozen=True)
class Disturbance:
    """Disturbances that an evaluation adds to a scenario; none by default.

    Raises:
        ValueError: on a value that is negative or not finite, or a wrong number of values.
    """

    roll_kick: float = 0.0
    """Impulse added once to the lean rate, rad/s, to the left or right at random."""
    kick_time: float = 2.0
    """Time of that impulse after the start, s."""
    initial_tilt: float = 0.0
    """Standard deviation of the lean angle at the start, rad."""
    displacement_noise: float = 0.0
    """Half width of uniform noise on the displacement, m (errata row 21)."""
    observation_noise: tuple[float, ...] = (0.0,) * 6
    """Standard deviation of Gaussian noise on each of OBSERVATION_FIELDS, in its unit."""
    action_delay: int = 0
    """Delay of an action, in steps; until the first arrives the bicycle gets zeros."""
    speed: float | None = None
    """Start speed instead of the scenario's, m/s."""

    def __post_init__(self) -> None:
        noise = tuple(self.observation_noise)
        object.__setattr__(self, "observation_noise", noise)
        require(len(noise) == 6, f"observation_noise needs 6 numbers, not {len(noise)}")
        for name in ("roll_kick", "kick_time", "initial_tilt", "displacement_noise"):
            value = getattr(self, name)
            require(_size(value), f"{name} must be 0 to {LARGEST:g}, not {value!r}")
        for name, value in zip(OBSERVATION_FIELDS, noise, strict=True):
            require(_size(value), f"noise on {name} must be 0 to {LARGEST:g}, not {value!r}")
        require(self.speed is None or _size(self.speed), f"a speed of {self.speed} cannot be")
        whole = isinstance(self.action_delay, int) and 0 <= self.action_delay <= 1000
        require(whole, f"action_delay must be 0 to 1000 whole steps, not {self.action_delay!r}")


def _size(value: Any) -> bool:
    """Return True if `value` is a nonnegative number whose square is finite."""
    return isinstance(value, (int, float)) and 0 <= value <= LARGEST


@dataclass(frozen=True)
class Rollouts:
    """Results of N rides; every field has shape (N,).

    A ride ends at the goal, at a fall or at the step limit.
    """

    reached: np.ndarray
    """bool: True if the goal was reached."""
    fallen: np.ndarray
    """bool: True if the bicycle fell."""
    steps: np.ndarray
    """int: number of steps ridden."""
    straight: np.ndarray
    """Distance from the start to the goal, m."""
    path: np.ndarray
    """Path length of the rear contact, m."""
    winding: np.ndarray
    """Angle by which the rear contact turned around the goal, rad, counter-clockwise."""
    peak_lean: np.ndarray
    """Largest |omega|, rad."""
    torque: np.ndarray
    """Mean |T| over the ride, N m."""
    displacement: np.ndarray
    """Mean |d| over the ride, m."""
    pedal_force: np.ndarray
    """Mean |F| over the ride, N."""
    score: np.ndarray
    """Sum of the rewards (eq. 20); a fall's last reward repeats to the step limit."""

    @classmethod
    def join(cls, parts: list[Rollouts]) -> Rollouts:
        """Concatenate several parts."""
        names = [item.name for item in fields(cls)]
        return cls(**{n: np.concatenate([getattr(part, n) for part in parts]) for n in names})


def ride(
    controller: Controller,
    scenario: Scenario,
    plant: Plant[Any],
    count: int,
    seed: int,
    disturbance: Disturbance | None = None,
    progress: bool = False,
) -> Rollouts:
    """Ride `count` bicycles until each has ended.

    Starts, goals, start tilts and kicks depend on `seed` alone, so every controller gets the same;
    the noise comes from a second stream and is equal only in distribution.

    Args:
        controller: chooses the actions.
        scenario: where from and where to, and within which limits.
        plant: which bicycle.
        count: N.
        seed: at least 0.
        disturbance: added to the scenario.
        progress: True to tell it on standard error.

    Raises:
        ValueError: if count or seed is too small, or the controller's actions are not finite or
            not (N, 3).
    """
    require(count >= 1, f"an evaluation needs at least one episode, not {count}")
    require(count <= MOST, f"an evaluation takes {MOST:,} episodes at most, not {count}")
    require(seed >= 0, f"a seed must be zero or more, not {seed}")
    trial = disturbance or Disturbance()
    if trial.speed is not None:
        scenario = replace(scenario, start_speed=trial.speed)
    if trial.displacement_noise > 0:
        plant = plant.with_displacement_noise(trial.displacement_noise)
    parts = []
    with ProgressBar(total=count, unit="ride", desc=scenario.name, shown=progress) as bar:
        for index, first in enumerate(range(0, count, CHUNK)):
            batch = _RolloutBatch(scenario, plant, min(CHUNK, count - first), (seed, index), trial)
            parts.append(batch.ride(controller, bar))
    return Rollouts.join(parts)


class _RolloutBatch:
    """Rides of one chunk: those still running, and the results of all."""

    def __init__(
        self,
        scenario: Scenario,
        plant: Plant[Any],
        count: int,
        seeds: tuple[int, int],
        trial: Disturbance,
    ) -> None:
        starts, self.noise = (np.random.default_rng((*seeds, use)) for use in (STARTS, NOISE))
        self.task = BicycleTask(scenario, plant, count, starts)
        self.task.rng = self.noise
        self.trial = trial
        if trial.initial_tilt > 0:
            self.task.state.lean_angle = starts.normal(0.0, trial.initial_tilt, count)
            self.task.state = plant.settled(self.task.state)
        self.kick = starts.choice((-1.0, 1.0), count) * trial.roll_kick
        self.kick_step = round(trial.kick_time / plant.time_step)
        delayed = (np.zeros((count, 3)) for _ in range(trial.action_delay))
        self.waiting: deque[np.ndarray] = deque(delayed)
        self.results: dict[str, np.ndarray] = {
            item.name: np.zeros(count) for item in fields(Rollouts)
        }
        self.results["straight"] = self.task.goal_distance()
        self.index = np.arange(count)
        self.sums = _Sums.of(self.task)

    def ride(self, controller: Controller, bar: Any) -> Rollouts:
        """Step until every ride has ended."""
        observation = self.task.observation()
        riding = Riding(controller, self.task.count, self.task.plant)
        while self.task.count:
            observation = self._step(riding, observation, bar)
        whole = {"reached": bool, "fallen": bool, "steps": np.int64}
        return Rollouts(**{n: v.astype(whole.get(n, float)) for n, v in self.results.items()})

    def _step(self, riding: Riding, observation: np.ndarray, bar: Any) -> np.ndarray:
        """Step the running rides; return the next observation of those that continue."""
        task = self.task
        limits, seen, speed = (
            task.scenario.action_limits,
            self._noisy(observation),
            task.state.speed,
        )
        chosen = riding.act(seen, speed)
        riding.acted(seen, speed, np.clip(chosen, -limits, limits))
        action = self._delay(chosen)
        if self.kick_step == task.steps[0] and self.trial.roll_kick > 0:
            task.state = task.plant.pushed(task.state, self.kick)
        before = task.state
        outcome = task.step(action)
        self.sums.add(task, before.rear_x, before.rear_y, action, outcome)
        ended = outcome.terminated | outcome.truncated | outcome.fallen
        if not ended.any():
            return outcome.observation
        self._store(outcome, ended)
        going = ~ended
        bar.update(int(ended.sum()))
        task.keep(going)
        self.index, self.kick = self.index[going], self.kick[going]
        self.sums.keep(going)
        riding.keep(going)
        self.waiting = deque(action[going] for action in self.waiting)
        return outcome.observation[going]

    def _noisy(self, observation: np.ndarray) -> np.ndarray:
        """Return the observation with its noise, as the controller sees it."""
        spread = self.trial.observation_noise
        if not any(spread):
            return observation
        return observation + self.noise.normal(size=observation.shape) * spread

    def _delay(self, action: np.ndarray) -> np.ndarray:
        """Return the delayed action that arrives at the bicycle."""
        self.waiting.append(action)
        return self.waiting.popleft()

    def _store(self, outcome: Step, ended: np.ndarray) -> None:
        """Store the results of the rides that end with this step."""
        to, task, steps = self.index[ended], self.task, self.task.steps[ended]
        left = np.where(outcome.fallen, task.scenario.max_steps - task.steps, 0)
        values = {
            "reached": outcome.terminated[ended],
            "fallen": outcome.fallen[ended],
            "steps": steps,
            "score": (self.sums.score + left * outcome.reward)[ended],
        }
        for name in ("path", "winding", "peak_lean"):
            values[name] = getattr(self.sums, name)[ended]
        names = ("torque", "displacement", "pedal_force")
        for name, total in zip(names, self.sums.effort.T, strict=True):
            values[name] = total[ended] / steps
        for name, value in values.items():
            self.results[name][to] = value


@dataclass
class _Sums:
    """Sums along each running ride; arrays of shape (N,) except `effort`."""

    path: np.ndarray
    winding: np.ndarray
    bearing: np.ndarray
    """Direction from the rear contact to the goal, rad."""
    peak_lean: np.ndarray
    score: np.ndarray
    effort: np.ndarray
    """(N, 3) sums of |T|, |d| and |F|."""

    @classmethod
    def of(cls, task: BicycleTask) -> _Sums:
        """Return the sums before the first step."""
        zero = np.zeros(task.count)
        bearing = task.state.heading - task.observation()[:, 5]
        lean = np.abs(task.state.lean_angle)
        return cls(zero, zero, bearing, lean, zero, np.zeros((task.count, 3)))

    def add(
        self,
        task: BicycleTask,
        rear_x: np.ndarray,
        rear_y: np.ndarray,
        action: np.ndarray,
        outcome: Step,
    ) -> None:
        """Add the step from the rear contacts (rear_x, rear_y)."""
        state = task.state
        self.path = self.path + np.hypot(state.rear_x - rear_x, state.rear_y - rear_y)
        bearing = state.heading - outcome.observation[:, 5]
        self.winding = self.winding + wrap_angle(bearing - self.bearing)
        self.bearing = bearing
        self.peak_lean = np.maximum(self.peak_lean, np.abs(state.lean_angle))
        self.score = self.score + outcome.reward
        self.effort = self.effort + np.minimum(np.abs(action), task.scenario.action_limits)

    def keep(self, mask: np.ndarray) -> None:
        """Keep only the rides of `mask` (N,)."""
        for name, values in vars(self).items():
            setattr(self, name, values[mask])
