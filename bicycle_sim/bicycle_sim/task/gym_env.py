"""The bicycle as a Gymnasium environment, one at a time or many at once.

After `import gymnasium`:

    gymnasium.make("bicycle_sim:BicycleGoal-v0", scenario="learned-speed")
    gymnasium.make_vec("bicycle_sim:BicycleGoal-v0", num_envs=64)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from bicycle_common.observation import ACTION_FIELDS
from bicycle_common.validation import require
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant
from bicycle_sim.task import registration
from bicycle_sim.task.registration import ENV_ID
from bicycle_sim.task.scenario import Scenario, named
from bicycle_sim.task.scene import Scene
from bicycle_sim.task.task import BicycleTask, Step

if TYPE_CHECKING:
    from bicycle_sim.task.render import Renderer

__all__ = ["AUTHORS_SCALE", "ENV_ID", "FALLS", "BicycleEnv", "BicycleVectorEnv"]

AUTHORS_SCALE = (math.pi / 2, 1.0, math.pi / 6, 1.0, 1.0, 1.0)
"""Divisors of the observation used by the paper's authors (errata row 35)."""

FALLS = ("freeze", "terminate")

WHEEL_RADIUS = 0.34
"""m, of the wheels in pictures."""

_METADATA: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 40}


class _Face:
    """Spaces, units and information shared by both environments."""

    def __init__(
        self,
        scenario: str | Scenario,
        plant: Plant[Any],
        fall: str,
        observation_scale: Sequence[float] | None,
        count: int,
    ) -> None:
        require(fall in FALLS, f"fall must be one of {', '.join(FALLS)}, not {fall!r}")
        scale = np.ones(6) if observation_scale is None else np.asarray(observation_scale, float)
        require(
            scale.shape == (6,) and bool(np.isfinite(scale).all() and (scale > 0).all()),
            f"observation_scale must be six numbers above zero, not {observation_scale!r}",
        )
        chosen = named(scenario) if isinstance(scenario, str) else scenario
        self.ends_at_fall = fall == "terminate"
        self.task = BicycleTask(chosen, plant, count, np.random.default_rng(0))
        self._scale = scale
        self._driven = np.flatnonzero(self.task.scenario.action_limits)
        require(len(self._driven) > 0, f"scenario {chosen.name} allows no action at all")
        self.action_names = tuple(ACTION_FIELDS[index] for index in self._driven)
        self.action_space = Box(-1.0, 1.0, (len(self._driven),), np.float32)
        stop = plant.geometry.steer_stop
        self._bounds = np.array([stop, 1e4, math.pi, 1e3, 1e4, math.pi])
        high = (self._bounds / scale).astype(np.float32)
        self.observation_space = Box(-high, high, dtype=np.float32)

    def observe(self, observation: np.ndarray) -> np.ndarray:
        """Return (N, 6) float32 within the space, from (N, 6) in SI units."""
        scaled = (np.clip(observation, -self._bounds, self._bounds) / self._scale).astype("f4")
        high = self.observation_space.high
        return np.clip(scaled, -high, high)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, Step, np.ndarray]:
        """Return observation (N, 6), the task's step, and if each episode terminated (N,)."""
        physical = np.zeros((self.task.count, 3))
        limits = self.task.scenario.action_limits[self._driven]
        physical[:, self._driven] = np.clip(action, -1.0, 1.0) * limits
        step = self.task.step(physical)
        ended = step.terminated | step.fallen if self.ends_at_fall else step.terminated
        return self.observe(step.observation), step, ended

    def render(self, renderers: Sequence[Renderer]) -> tuple[np.ndarray, ...]:
        """Pictures of the first bicycles, one for each renderer, (480, 640, 3) uint8."""
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
                    wheel_radius=WHEEL_RADIUS,
                    fallen=bool(task.fallen[index]),
                )
            )
            for index, renderer in enumerate(renderers)
        )

    def info(self, step: Step | None = None) -> dict[str, np.ndarray]:
        """Return information beside the observation, arrays of shape (N,); see `BicycleEnv`."""
        found = {
            "is_success": np.zeros(self.task.count, dtype=bool)
            if step is None
            else step.terminated.copy(),
            "fallen": self.task.fallen.copy(),
            "goal_distance": self.task.goal_distance(),
            "speed": self.task.state.speed.copy(),
        }
        for name in ("lean_angle", "lean_rate", "lean_acceleration", "heading_error"):
            value = np.zeros(self.task.count) if step is None else step.terms[name] + 0.0
            found[f"reward_{name}"] = value
        return found


def _plant(plant: str | Plant[Any], bicycle: str | None, physics: str) -> Plant[Any]:
    return registry.named(plant, bicycle, physics) if isinstance(plant, str) else plant


class BicycleEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """Balance a bicycle and ride it to a goal (Choi, Le et al. 2019).

    ## Action space

    `Box(-1, 1, (k,), float32)`: one number for each action that the scenario allows, in this
    order, as a share of its limit. A scenario with a limit of zero lacks that action.

    | action       | symbol | limit (either way)          | unit |
    | ------------ | ------ | --------------------------- | ---- |
    | torque       | T      | 2                           | N m  |
    | displacement | d      | 0.2 or 0.02, by scenario    | m    |
    | pedal force  | F      | 100; none at a fixed speed  | N    |

    ## Observation space

    `Box((6,), float32)`, in the paper's signs: lean and steering positive to the left, the
    heading error positive when the goal lies to the right. With `observation_scale` each
    number is divided by one of six. Values beyond the bounds are clipped to them.

    | observation       | symbol         | min     | max    | unit    |
    | ----------------- | -------------- | ------- | ------ | ------- |
    | steer angle       | theta          | -1.3963 | 1.3963 | rad     |
    | steer rate        | theta dot      | -1e4    | 1e4    | rad/s   |
    | lean angle        | omega          | -pi     | pi     | rad     |
    | lean rate         | omega dot      | -1e3    | 1e3    | rad/s   |
    | lean acceleration | omega dot dot  | -1e4    | 1e4    | rad/s^2 |
    | heading error     | psi_g          | -pi     | pi     | rad     |

    ## Reward

    -(omega^2 + 0.1 omega_dot^2 + 0.01 omega_dot_dot^2 + 2 psi_g^2) (eq. 20), never positive.

    ## Starting state

    Upright, straight, at the scenario's speed; place, heading and goal drawn as it says.

    ## Episode end

    Terminated: the rear contact is within 1 m of the goal, upright. Truncated: the scenario's
    `max_steps`; do not also wrap it in a `TimeLimit`. A fall, |omega| > pi/6, ends nothing:
    the state freezes and its reward repeats (errata row 25). With `fall="terminate"` a fall
    terminates too; since no reward is positive, that invites an agent to fall early.

    ## Information

    | key                        | meaning                                        | unit |
    | -------------------------- | ---------------------------------------------- | ---- |
    | is_success                 | whether the goal was reached in this step      | bool |
    | fallen                     | whether the bicycle lies                       | bool |
    | goal_distance              | rear contact to goal                           | m    |
    | speed                      | v                                              | m/s  |
    | reward_lean_angle, ...     | the four terms of the reward; zero after reset | -    |

    Version history: v0 is the first.
    """

    metadata: dict[str, Any] = _METADATA

    def __init__(
        self,
        scenario: str | Scenario = "random-start-random-goal",
        physics: str = "faithful",
        fall: str = "freeze",
        observation_scale: Sequence[float] | None = None,
        render_mode: str | None = None,
        plant: str | Plant[Any] = "choi",
        bicycle: str | None = None,
    ) -> None:
        """Create one bicycle.

        Args:
            scenario: a name of `bicycle_sim.task.scenario.SCENARIOS`, or a scenario.
            physics: `faithful` or `corrected`, of the plant choi.
            fall: `freeze` or `terminate`.
            observation_scale: six divisors, such as AUTHORS_SCALE; SI units by default.
            render_mode: None, or `rgb_array` for pictures of (480, 640, 3) uint8.
            plant: `choi`, `whipple`, or any plant, which needs no names.
            bicycle: of the plant whipple, a name or a YAML file.

        Raises:
            ValueError: on an unknown name or value.
        """
        self.render_mode = _checked(render_mode)
        self._face = _Face(scenario, _plant(plant, bicycle, physics), fall, observation_scale, 1)
        self.action_space = self._face.action_space
        self.observation_space = self._face.observation_space
        self._renderers: list[Renderer] = []

    @property
    def task(self) -> BicycleTask:
        """Underlying task, a batch of one."""
        return self._face.task

    @property
    def action_names(self) -> tuple[str, ...]:
        """Names of the actions that the action space drives, in order."""
        return self._face.action_names

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode; there are no options."""
        super().reset(seed=seed)
        self.task.rng = self.np_random
        self.task.reset()
        self._renderers = []
        return self._face.observe(self.task.observation())[0], _only(self._face.info())

    def render(self) -> np.ndarray | None:
        """Return a picture of the bicycle from behind, or None without a render mode."""
        if self.render_mode is None:
            return None
        self._renderers = self._renderers or _renderers(1)
        return self._face.render(self._renderers)[0]

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Simulate one time step, 0.025 s.

        Raises:
            ValueError: if the action is not finite.
        """
        observation, step, ended = self._face.step(np.asarray(action)[None])
        truncated = bool(step.truncated[0] and not ended[0])
        info = _only(self._face.info(step))
        return observation[0], float(step.reward[0]), bool(ended[0]), truncated, info


class BicycleVectorEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """N bicycles in one array program; each as in `BicycleEnv`.

    An ended episode is restarted by the next step, which ignores its action and returns a reward
    of zero for it (Gymnasium's next-step autoreset). All bicycles share one seed.
    """

    metadata: dict[str, Any] = _METADATA | {"autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str | Scenario = "random-start-random-goal",
        physics: str = "faithful",
        fall: str = "freeze",
        observation_scale: Sequence[float] | None = None,
        render_mode: str | None = None,
        plant: str | Plant[Any] = "choi",
        bicycle: str | None = None,
    ) -> None:
        """Create `num_envs` bicycles; see `BicycleEnv` for the other arguments.

        Raises:
            ValueError: on an unknown name or value.
        """
        self.render_mode = _checked(render_mode)
        self.num_envs = num_envs
        self._face = _Face(
            scenario, _plant(plant, bicycle, physics), fall, observation_scale, num_envs
        )
        self.single_action_space = self._face.action_space
        self.single_observation_space = self._face.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._ended = np.zeros(num_envs, dtype=bool)
        self._renderers: list[Renderer] = []

    @property
    def task(self) -> BicycleTask:
        """Underlying task, a batch of N."""
        return self._face.task

    @property
    def action_names(self) -> tuple[str, ...]:
        """Names of the actions that an action drives, in order."""
        return self._face.action_names

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode for every bicycle; there are no options."""
        super().reset(seed=seed)
        self.task.rng = self.np_random
        self._ended = np.zeros(self.num_envs, dtype=bool)
        self.task.reset()
        self._renderers = []
        return self._face.observe(self.task.observation()), _masked(self._face.info())

    def render(self) -> tuple[np.ndarray, ...] | None:
        """Return one picture for each bicycle, or None without a render mode."""
        if self.render_mode is None:
            return None
        self._renderers = self._renderers or _renderers(self.num_envs)
        return self._face.render(self._renderers)

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Step every bicycle that rides, restart every one whose episode ended.

        Raises:
            ValueError: if an action is not finite.
        """
        fresh = self._ended
        observation, step, ended = self._face.step(actions)
        truncated = step.truncated & ~ended
        reward, info = step.reward + 0.0, self._face.info(step)
        if fresh.any():
            self.task.reset(fresh)
            for index in np.flatnonzero(fresh[: len(self._renderers)]):
                self._renderers[index].clear()
            observation = self._face.observe(self.task.observation())
            ended, truncated = ended & ~fresh, truncated & ~fresh
            reward[fresh] = 0.0
            begun = self._face.info()
            info = {name: np.where(fresh, begun[name], value) for name, value in info.items()}
        self._ended = ended | truncated
        return observation, reward, ended, truncated, _masked(info)


def _checked(render_mode: str | None) -> str | None:
    """Return a render mode that there is.

    Raises:
        ValueError: on any other.
    """
    known = _METADATA["render_modes"]
    require(
        render_mode is None or render_mode in known,
        f"render_mode must be None or {' or '.join(known)}, not {render_mode!r}",
    )
    return render_mode


def _renderers(count: int) -> list[Renderer]:
    """Make renderers; matplotlib is imported by who wants pictures only."""
    from bicycle_sim.task.render import Renderer

    return [Renderer() for _ in range(count)]


def _only(info: dict[str, np.ndarray]) -> dict[str, Any]:
    """Return plain numbers from arrays of length one."""
    return {name: value[0].item() for name, value in info.items()}


def _masked(info: dict[str, np.ndarray]) -> dict[str, Any]:
    """Return the same with Gymnasium's masks, which mark the bicycles with a value: all."""
    masks = {f"_{name}": np.ones(len(value), dtype=bool) for name, value in info.items()}
    return info | masks


registration.register()
