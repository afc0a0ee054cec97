"""The bicycle as a Gymnasium environment; `vector_env.py` has many at once.

After `import gymnasium`:

    gymnasium.make("bicycle_sim:BicycleGoal-v0", scenario="learned-speed")
    gymnasium.make("bicycle/learned-speed-train-v0", observation_scale="natural")
    gymnasium.make_vec("bicycle_sim:BicycleGoal-v0", num_envs=64)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from bicycle_sim.plants.base import Plant
from bicycle_sim.task import env_options, registration
from bicycle_sim.task.env_core import (
    AUTHORS_SCALE,
    DISCOUNT,
    FALLS,
    METADATA,
    NATURAL_SCALE,
    EnvConfig,
    EnvCore,
    EnvProperties,
    checked_mode,
    new_renderers,
    only,
)
from bicycle_sim.task.registration import ENV_ID
from bicycle_sim.task.scenario import Scenario
from bicycle_sim.task.training_variant import TrainingVariant
from bicycle_sim.task.vector_env import BicycleVectorEnv

if TYPE_CHECKING:
    from bicycle_sim.task.picture_page import PicturePage
    from bicycle_sim.task.render import Renderer

__all__ = [
    "AUTHORS_SCALE",
    "ENV_ID",
    "FALLS",
    "NATURAL_SCALE",
    "BicycleEnv",
    "BicycleVectorEnv",
]


class BicycleEnv(EnvProperties, gymnasium.Env[np.ndarray, np.ndarray]):
    """Balance a bicycle and ride it to a goal (Choi, Le et al. 2019).

    # Action space

    `Box(-1, 1, (k,), float32)`: one number for each action that the scenario allows, in this
    order, as a share of its limit. A scenario with a limit of zero lacks that action.

    | action       | symbol | limit (either way)          | unit |
    | ------------ | ------ | --------------------------- | ---- |
    | torque       | T      | 2                           | N m  |
    | displacement | d      | 0.2 or 0.02, by scenario    | m    |
    | pedal force  | F      | 100; none at a fixed speed  | N    |

    # Observation space

    `Box((6,), float32)`, in the paper's signs: lean and steering positive to the left, the
    heading error positive when the goal lies to the right. With `observation_scale` each
    number is divided by one of six: `natural` brings those of ordinary rides into -1..1
    (attribute `natural_scale`). Values beyond the bounds are clipped to them.

    | observation       | symbol         | min     | max    | unit    |
    | ----------------- | -------------- | ------- | ------ | ------- |
    | steer angle       | theta          | -1.3963 | 1.3963 | rad     |
    | steer rate        | theta dot      | -100    | 100    | rad/s   |
    | lean angle        | omega          | -pi/2   | pi/2   | rad     |
    | lean rate         | omega dot      | -30     | 30     | rad/s   |
    | lean acceleration | omega dot dot  | -300    | 300    | rad/s^2 |
    | heading error     | psi_g          | -pi     | pi     | rad     |

    # Reward

    -(omega^2 + 0.1 omega_dot^2 + 0.01 omega_dot_dot^2 + 2 psi_g^2) (eq. 20), never positive.

    # Starting state

    Upright, straight, at the scenario's speed; place, heading and goal drawn as it says, or given
    by `reset(options={"start": (x, y), "goal": (x, y), "heading": rad, "speed": m/s})`.

    # Episode end

    Terminated: the rear contact is within 1 m of the goal, upright. Truncated: the scenario's
    `max_steps` (`spec.max_episode_steps`). A fall, |omega| > pi/6, ends nothing: the state
    freezes and its reward repeats (errata row 25). With `fall="value"` a fall terminates, and its
    reward is what repeating it for ever is worth, r / (1 - discount). With `fall="terminate"` it
    terminates and counts once; since no reward is positive, that invites an agent to fall early.

    # Training variant

    With `variant="training"`, or an id `bicycle/<scenario>-train-v0`, stock learners can learn:
    a step costs at most 4, rewards are multiplied by 0.05, a fall ends with its value, half of the
    goals are within 15 m, bicycles start tilted, and an episode has at most 600 steps. Each is a
    field of `TrainingVariant`. Evaluate on the scenario itself, with the same observation scale.

    # Information

    | key                        | meaning                                        | unit |
    | -------------------------- | ---------------------------------------------- | ---- |
    | is_success                 | whether the goal was reached in this step      | bool |
    | fallen                     | whether the bicycle lies                       | bool |
    | goal_distance              | rear contact to goal                           | m    |
    | speed                      | v                                              | m/s  |
    | episode_return             | sum of the episode's rewards so far            | -    |
    | episode_length             | steps of the episode so far                    | -    |
    | reward_lean_angle, ...     | the four terms of the reward; zero after reset | -    |

    Version history: v0 is the first.
    """

    metadata: dict[str, Any] = METADATA

    def __init__(
        self,
        scenario: str | Scenario = "random-start-random-goal",
        physics: str = "faithful",
        fall: str | None = None,
        observation_scale: str | Sequence[float] | None = None,
        render_mode: str | None = None,
        plant: str | Plant[Any] = "choi",
        bicycle: str | None = None,
        variant: str | TrainingVariant = "evaluation",
        discount: float = DISCOUNT,
        max_episode_steps: int | None = None,
    ) -> None:
        """Create one bicycle.

        Args:
            scenario: a name of `bicycle_sim.task.scenario.SCENARIOS`, or a scenario.
            physics: `faithful` or `corrected`, of the plant choi.
            fall: `freeze`, `terminate` or `value`; by default `freeze`, and `value` in training.
            observation_scale: `natural`, `authors` or six divisors; SI units by default.
            render_mode: None; `rgb_array` for pictures of (480, 640, 3) uint8; `human` for a page
                of pictures in the browser, at an address that is printed.
            plant: `choi`, `whipple`, or any plant, which needs no names.
            bicycle: of the plant whipple, a name or a YAML file.
            variant: `evaluation`, `training`, or a training variant.
            discount: of the value of a fall, with `fall="value"`.
            max_episode_steps: step limit in place of the scenario's.

        Raises:
            ValueError: on an unknown name or value.
        """
        self.render_mode = checked_mode(render_mode)
        config = EnvConfig(
            scenario,
            physics,
            fall,
            observation_scale,
            plant,
            bicycle,
            variant,
            discount,
            max_episode_steps,
        )
        self._core = EnvCore(config, 1)
        self.step_one = self._core.step_one
        self.action_space = self._core.action_space
        self.observation_space = self._core.observation_space
        self._spec: Any = None
        self._renderers: list[Renderer] = []
        self._page: PicturePage | None = None

    @property
    def spec(self) -> Any:
        """Gymnasium's specification, with the step limit of this very scenario."""
        return self._spec

    @spec.setter
    def spec(self, spec: Any) -> None:
        limit = self.task.scenario.max_steps
        self._spec = spec if spec is None else replace_limit(spec, limit)

    @property
    def goal(self) -> tuple[float, float]:
        """Goal, m; it may be set between steps."""
        x, y = self._core.goals()[0].tolist()
        return x, y

    @goal.setter
    def goal(self, goal: tuple[float, float]) -> None:
        self._core.set_goals(np.asarray(goal, float)[None])

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: of start, heading, goal and noise.
            options: `start`, `goal`, `heading`, `speed`; see `env_options.read`.

        Raises:
            ValueError: on an unknown option or value.
        """
        chosen = env_options.read(options, 1, self.task.scenario, many=False)
        super().reset(seed=seed)
        self._core.seed([self.np_random])
        self._core.begin(np.ones(1, dtype=bool), chosen)
        for renderer in self._renderers:
            renderer.clear()
        self._show()
        return self._core.observe()[0], only(self._core.info())

    def render(self) -> np.ndarray | None:
        """Return a picture of the bicycle from behind, or None without `rgb_array`."""
        return self._picture() if self.render_mode == "rgb_array" else None

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Simulate one time step, 0.025 s.

        Raises:
            ValueError: if the action has a wrong shape or is not finite.
        """
        if self.render_mode != "human":
            return self.step_one(action)
        found = self.step_one(action)
        self._show()
        return found

    def close(self) -> None:
        """Close the page of `human`."""
        if self._page is not None:
            self._page.close()
            self._page = None

    def _picture(self) -> np.ndarray:
        self._renderers = self._renderers or new_renderers(1)
        return self._core.render(self._renderers)[0]

    def _show(self) -> None:
        """Show a picture on the page of `human` and keep to real time."""
        if self.render_mode != "human":
            return
        if self._page is None:
            from bicycle_sim.task.picture_page import PicturePage

            self._page = PicturePage(self.task.plant.time_step)
        self._page.show(self._picture)


def replace_limit(spec: Any, limit: int) -> Any:
    """Return a specification with the step limit `limit`; the registered one stays."""
    return replace(spec, max_episode_steps=limit)


registration.register()
