"""Common part of one bicycle and N bicycles as Gymnasium environments.

Spaces, units, starts, rewards, ends and information are decided here once; `gym_env.py` and
`vector_env.py` give them the shapes that Gymnasium asks for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.spaces import Box

from bicycle_common.geometry import wrap_angle
from bicycle_common.observation import ACTION_FIELDS
from bicycle_common.validation import require
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant
from bicycle_sim.task.env_options import ResetOptions
from bicycle_sim.task.native_task import DISTANCE, REWARD, TERMS, Face
from bicycle_sim.task.scenario import Scenario, named
from bicycle_sim.task.scene import Scene
from bicycle_sim.task.task import TERM_FIELDS, BicycleTask, Step, draw_starts
from bicycle_sim.task.training_variant import TrainingVariant, variant_named

if TYPE_CHECKING:
    from bicycle_sim.task.render import Renderer

AUTHORS_SCALE = (math.pi / 2, 1.0, math.pi / 6, 1.0, 1.0, 1.0)
"""Divisors of the observation used by the paper's authors (errata row 35)."""
NATURAL_SCALE = (0.8, 3.0, 0.3, 1.0, 5.0, 2.0)
"""Divisors that bring the observation of ordinary rides into -1..1."""
SCALES = {"natural": NATURAL_SCALE, "authors": AUTHORS_SCALE}
"""Scales that have a name."""
BOUNDS = (100.0, math.pi / 2, 30.0, 300.0, math.pi)
"""Largest steer rate, lean, lean rate, lean acceleration and heading error, rad and s. No ride
comes near the middle four: a fallen bicycle's state freezes."""
FALLS = ("freeze", "terminate", "value")
DISCOUNT = 0.99
"""Discount of the sum of rewards that a fall is worth with `fall="value"`."""
METADATA: dict[str, Any] = {"render_modes": ["rgb_array", "human"], "render_fps": 40}
_SPEED_ROW = 10
"""Row of a compiled result that holds the speed."""

Info = dict[str, np.ndarray]


@dataclass(frozen=True)
class EnvConfig:
    """Arguments that both environments take; see `gym_env.BicycleEnv`."""

    scenario: str | Scenario = "random-start-random-goal"
    physics: str = "faithful"
    fall: str | None = None
    observation_scale: str | Sequence[float] | None = None
    plant: str | Plant[Any] = "choi"
    bicycle: str | None = None
    variant: str | TrainingVariant = "evaluation"
    discount: float = DISCOUNT
    max_episode_steps: int | None = None


class EnvCore:
    """N bicycles on one scenario, with the units and rewards of an environment."""

    def __init__(self, config: EnvConfig, count: int) -> None:
        """Place the bicycles.

        Raises:
            ValueError: on an unknown name or a value out of range.
        """
        variant = config.variant
        self.variant = variant_named(variant) if isinstance(variant, str) else variant
        self.fall = config.fall or ("freeze" if self.variant is None else "value")
        require(self.fall in FALLS, f"fall must be one of {', '.join(FALLS)}, not {self.fall!r}")
        self.ends_at_fall = self.fall != "freeze"
        require(0 <= config.discount < 1, f"discount must lie in 0..1, not {config.discount!r}")
        self.discount = config.discount
        self.task = BicycleTask(
            self._scenario(config), self._plant(config), count, np.random.default_rng(0)
        )
        self.observation_scale = self._scale(config.observation_scale)
        self.rngs: list[np.random.Generator] = []
        self._returns = np.zeros(count)
        self._make_spaces()

    def _scenario(self, config: EnvConfig) -> Scenario:
        chosen = config.scenario
        found = named(chosen) if isinstance(chosen, str) else chosen
        if self.variant is not None:
            found = self.variant.scenario(found)
        if config.max_episode_steps is not None:
            found = replace(found, max_steps=config.max_episode_steps)
        return found

    @staticmethod
    def _plant(config: EnvConfig) -> Plant[Any]:
        if not isinstance(config.plant, str):
            return config.plant
        return registry.named(config.plant, config.bicycle, config.physics)

    @staticmethod
    def _scale(scale: str | Sequence[float] | None) -> np.ndarray:
        found = SCALES.get(scale) if isinstance(scale, str) else scale
        known = " or ".join(repr(name) for name in SCALES)
        message = f"observation_scale must be {known}, or six numbers above zero, not {scale!r}"
        require(found is not None or scale is None, message)
        array = np.ones(6) if found is None else np.asarray(found, float)
        good = array.shape == (6,) and np.isfinite(array).all() and (array > 0).all()
        require(bool(good), message)
        return array

    def _make_spaces(self) -> None:
        task = self.task
        limits = task.scenario.action_limits
        self._driven = np.flatnonzero(limits)
        self._limits = limits[self._driven]
        require(len(self._driven) > 0, f"scenario {task.scenario.name} allows no action at all")
        self.action_names = tuple(ACTION_FIELDS[index] for index in self._driven)
        self.action_space = Box(-1.0, 1.0, (len(self._driven),), np.float32)
        self._bounds = np.array([task.plant.geometry.steer_stop, *BOUNDS])
        self._high = (self._bounds / self.observation_scale).astype(np.float32)
        self.observation_space = Box(-self._high, self._high, dtype=np.float32)
        face = Face.of(
            self._driven, self._limits, self._bounds, self.observation_scale, self._high
        )
        self.compiled = task.scale(face)

    def seed(self, rngs: list[np.random.Generator]) -> None:
        """Draw from one generator for each bicycle from now on."""
        self.rngs = rngs
        self.task.noise_rngs = rngs

    def begin(self, mask: np.ndarray, options: ResetOptions) -> None:
        """Begin an episode for each bicycle of `mask` (N,), as `options` says or by chance.

        A bicycle draws from its own generator alone, and as often whatever the options.
        """
        who = np.flatnonzero(mask)
        scenario, variant = self.task.scenario, self.variant
        start, goal, tilt = np.zeros((len(who), 2)), np.zeros((len(who), 2)), None
        heading, speed = np.zeros(len(who)), np.full(len(who), scenario.start_speed)
        tilt = np.zeros((len(who), 4))
        for row, index in enumerate(who):
            rng = self.rngs[index]
            (start[row],), (heading[row],), (goal[row],) = draw_starts(scenario, 1, rng)
            if options.start is not None:
                start[row] = options.start[index]
            if variant is not None:
                speed[row], tilt[row] = variant.start_speed(scenario, rng), variant.tilts(rng)
                goal[row] = variant.goal(start[row], goal[row], rng)
        goal = goal if options.goal is None else options.goal[who]
        heading = heading if options.heading is None else wrap_angle(options.heading[who])
        speed = speed if options.speed is None else options.speed[who].copy()
        self.task.place(mask, start[:, 0], start[:, 1], heading, goal[:, 0], goal[:, 1], speed)
        if variant is not None:
            self._tilt(who, tilt)
        self._returns[who] = 0.0

    def _tilt(self, who: np.ndarray, tilt: np.ndarray) -> None:
        """Lean and steer the bicycles `who` (M,) by (M, 4) rad and rad/s."""
        state = self.task.state
        names = ("lean_angle", "lean_rate", "steer_angle", "steer_rate")
        changed = {name: getattr(state, name).copy() for name in names}
        for name, column in zip(names, tilt.T, strict=True):
            changed[name][who] = column
        self.task.state = self.task.plant.settled(replace(state, **changed))

    def observe(self, observation: np.ndarray | None = None) -> np.ndarray:
        """Return (N, 6) float32 within the space, from (N, 6) in SI units; now by default."""
        if observation is None:
            observation = self.task.observation()
        bounds, scale = self._bounds, self.observation_scale
        scaled = (np.clip(observation, -bounds, bounds) / scale).astype("f4")
        return np.clip(scaled, -self._high, self._high)

    def step(
        self, action: np.ndarray, resting: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, Step]:
        """Step every bicycle.

        Args:
            action: (N, k), shares of the limits.
            resting: (N,) bool, bicycles whose step will be thrown away: they draw no noise.

        Returns:
            Observation (N, 6), reward (N,), if each episode terminated (N,), the task's step.

        Raises:
            ValueError: if the shape is not (N, k) or a value is not finite.
        """
        action = np.asarray(action)
        shape = (self.task.count, len(self._driven))
        if action.shape != shape:
            raise ValueError(f"action must have shape {shape}, not {action.shape}")
        if resting is not None and self.task.plant.displacement_noise > 0:
            pairs = zip(self.rngs, resting, strict=True)
            self.task.noise_rngs = [None if rests else rng for rng, rests in pairs]
        if self.compiled:
            observation = self.task.advance(action).observation
            step = self.task.advanced()
        else:
            physical = np.zeros((self.task.count, 3))
            physical[:, self._driven] = np.clip(action, -1.0, 1.0) * self._limits
            step = self.task.step(physical)
            observation = self.observe(step.observation)
        reward = self._worth(step)
        self._returns = self._returns + reward
        ended = step.terminated | step.fallen if self.ends_at_fall else step.terminated
        return observation, reward, ended, step

    def _worth(self, step: Step) -> np.ndarray:
        """Reward of a step (N,), as variant and fall have it."""
        reward, variant = step.reward + 0.0, self.variant
        if variant is not None:
            reward = np.maximum(reward, -variant.cost_cap)
        if self.fall == "value":
            reward = np.where(step.fallen, reward / (1.0 - self.discount), reward)
        return reward if variant is None else reward * variant.reward_scale

    def step_one(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Step one bicycle, in plain numbers: the bits of `step`, at a fraction of its cost.

        Returns:
            What `gymnasium.Env.step` returns.
        """
        if not self.compiled:
            return self._only(action)
        action = np.asarray(action)
        if action.shape != self.action_space.shape:
            raise ValueError(
                f"action must have shape {self.action_space.shape}, not {action.shape}"
            )
        task = self.task
        native = task.advance(action)
        row = native.result.ravel().tolist()
        reached, cut, fallen = native.ends.ravel().tolist()
        reward, variant = row[REWARD], self.variant
        if variant is not None and reward < -variant.cost_cap:
            reward = -variant.cost_cap
        if fallen and self.fall == "value":
            reward /= 1.0 - self.discount
        if variant is not None:
            reward *= variant.reward_scale
        self._returns[0] = total = self._returns.item() + reward
        ended = reached or (fallen and self.ends_at_fall)
        one, two, three, four = row[TERMS:DISTANCE]
        info = {
            "is_success": reached,
            "fallen": fallen,
            "goal_distance": row[DISTANCE],
            "speed": row[_SPEED_ROW],
            "episode_return": total,
            "episode_length": task.steps.item(),
            "reward_lean_angle": one,
            "reward_lean_rate": two,
            "reward_lean_acceleration": three,
            "reward_heading_error": four,
        }
        return native.observation[0], reward, ended, cut and not ended, info

    def _only(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Make `step_one` by `step`."""
        observation, reward, ended, step = self.step(np.asarray(action)[None])
        truncated = bool(step.truncated[0] and not ended[0])
        return (
            observation[0],
            float(reward[0]),
            bool(ended[0]),
            truncated,
            only(self.info(step)),
        )

    def info(self, step: Step | None = None) -> Info:
        """Return information beside the observation, arrays of shape (N,); see `BicycleEnv`."""
        count = self.task.count
        found = {
            "is_success": np.zeros(count, dtype=bool) if step is None else step.terminated.copy(),
            "fallen": self.task.fallen.copy(),
            "goal_distance": self.task.goal_distance() if step is None else step.distance.copy(),
            "speed": self.task.state.speed.copy(),
            "episode_return": self._returns.copy(),
            "episode_length": self.task.steps.copy(),
        }
        for name in TERM_FIELDS:
            value = np.zeros(count) if step is None else step.terms[name] + 0.0
            found[f"reward_{name}"] = value
        return found

    def goals(self) -> np.ndarray:
        """Return the goals (N, 2), m."""
        return np.column_stack([self.task.goal_x, self.task.goal_y])

    def set_goals(self, goals: np.ndarray) -> None:
        """Move the goals to (N, 2), m."""
        self.task.goal_x, self.task.goal_y = (column.copy() for column in goals.T)

    def render(self, renderers: Sequence[Renderer]) -> tuple[np.ndarray, ...]:
        """Return pictures of the first bicycles, one for each renderer, (480, 640, 3) uint8."""
        state, task = self.task.state, self.task
        return tuple(
            renderer.draw(
                Scene(
                    rear=(float(state.rear_x[index]), float(state.rear_y[index])),
                    front=(float(state.front_x[index]), float(state.front_y[index])),
                    lean_angle=float(state.lean_angle[index]),
                    steer_angle=float(state.steer_angle[index]),
                    speed=float(state.speed[index]),
                    goal=(float(task.goal_x[index]), float(task.goal_y[index])),
                    goal_radius=task.scenario.goal_radius,
                    wheel_radius=task.plant.geometry.rear_radius,
                    fallen=bool(task.fallen[index]),
                )
            )
            for index, renderer in enumerate(renderers)
        )


def checked_mode(render_mode: str | None) -> str | None:
    """Return a render mode that there is.

    Raises:
        ValueError: on any other.
    """
    known = METADATA["render_modes"]
    require(
        render_mode is None or render_mode in known,
        f"render_mode must be None or {' or '.join(known)}, not {render_mode!r}",
    )
    return render_mode


def new_renderers(count: int) -> list[Renderer]:
    """Make renderers; matplotlib is imported by who wants pictures only."""
    from bicycle_sim.task.render import Renderer

    return [Renderer() for _ in range(count)]


def only(info: Info) -> dict[str, Any]:
    """Return plain numbers from arrays of length one."""
    return {name: value[0].item() for name, value in info.items()}


class EnvProperties:
    """Words of both environments about their bicycles."""

    natural_scale = np.array(NATURAL_SCALE)
    """(6,) divisors that bring the observation of ordinary rides into -1..1."""
    _core: EnvCore

    @property
    def task(self) -> BicycleTask:
        """Underlying task: a batch of one, or of N."""
        return self._core.task

    @property
    def scenario(self) -> Scenario:
        """Scenario that is ridden, with the step limit of its variant."""
        return self.task.scenario

    @property
    def action_names(self) -> tuple[str, ...]:
        """Names of the actions that an action drives, in order."""
        return self._core.action_names

    @property
    def observation_scale(self) -> np.ndarray:
        """(6,) divisors of the observation."""
        return self._core.observation_scale
