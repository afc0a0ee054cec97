"""N bicycles for stable-baselines3: its `VecEnv` on the fast vector environment.

    from stable_baselines3 import PPO
    from bicycle_sim.task.sb3 import BicycleVecEnv

    env = BicycleVecEnv("bicycle/learned-speed-train-v0", 64, observation_scale="natural")
    PPO("MlpPolicy", env).learn(500_000)

Only this module needs stable-baselines3, which is in no requirement of this project.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv

from bicycle_common.validation import require
from bicycle_sim.task import registration
from bicycle_sim.task.vector_env import BicycleVectorEnv

Indices = None | int | Iterable[int]


class BicycleVecEnv(VecEnv):
    """A stable-baselines3 vector environment of N bicycles, stepped in one call.

    Ended episodes begin again in the same step, with `terminal_observation`, `TimeLimit.truncated`
    and the statistics `episode` in the information of that step, as `Monitor` writes them; the
    information of other steps is empty. Seeds are those of `BicycleVectorEnv`.
    """

    def __init__(self, env_id: str, n_envs: int = 1, **environment: Any) -> None:
        """Create the bicycles.

        Args:
            env_id: `BicycleGoal-v0`, or the id of a scenario.
            n_envs: N.
            environment: further arguments of `BicycleVectorEnv`.

        Raises:
            ValueError: on another id, or a value that makes no sense.
        """
        registration.register()
        name = env_id.removeprefix("bicycle_sim:")
        require(
            name in registration.env_ids(),
            f"BicycleVecEnv takes {', '.join(registration.env_ids())}; not {env_id!r}",
        )
        values = dict(gymnasium.spec(name).kwargs) | environment
        self.envs = BicycleVectorEnv(n_envs, **values, autoreset_mode=AutoresetMode.SAME_STEP)
        self._begun = time.monotonic()
        self._actions = np.zeros((n_envs, len(self.envs.action_names)), np.float32)
        super().__init__(n_envs, self.envs.single_observation_space, self.envs.single_action_space)

    def reset(self) -> np.ndarray:
        """Begin an episode for every bicycle; return (N, 6) observations."""
        seeds = self._seeds if any(seed is not None for seed in self._seeds) else None
        observation, info = self.envs.reset(seed=seeds, options=_joined(self._options))
        self.reset_infos = [
            {name: info[name][index].item() for name in info if not name.startswith("_")}
            for index in range(self.num_envs)
        ]
        self._reset_seeds()
        self._reset_options()
        return observation

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions (N, k) for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Step every bicycle; return observations, rewards, ends and information."""
        observation, reward, terminated, truncated, info = self.envs.step(self._actions)
        done = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for index in np.flatnonzero(done).tolist():
            infos[index] = self._ended(index, info, bool(truncated[index]))
        return observation, reward.astype(np.float32), done, infos

    def _ended(self, index: int, info: dict[str, Any], truncated: bool) -> dict[str, Any]:
        """Return the information of an episode that has ended."""
        last = info["final_info"]
        found = {name: last[name][index].item() for name in last if not name.startswith("_")}
        return found | {
            "terminal_observation": info["final_obs"][index],
            "TimeLimit.truncated": truncated,
            "episode": {
                "r": round(found["episode_return"], 6),
                "l": found["episode_length"],
                "t": round(time.monotonic() - self._begun, 6),
            },
        }

    def close(self) -> None:
        """Close the bicycles' page, if there is one."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """Return an attribute of each bicycle, see `BicycleVectorEnv.get_attr`."""
        values = self.envs.get_attr(attr_name)
        return [values[index] for index in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Set an attribute of each bicycle, see `BicycleVectorEnv.set_attr`."""
        values = list(self.envs.get_attr(attr_name))
        for index in self._get_indices(indices):
            values[index] = value
        self.envs.set_attr(attr_name, values)

    def env_method(
        self, method_name: str, *args: Any, indices: Indices = None, **kwargs: Any
    ) -> list[Any]:
        """Return what a method of each bicycle returns, see `BicycleVectorEnv.call`."""
        values = self.envs.call(method_name, *args, **kwargs)
        return [values[index] for index in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Indices = None) -> list[bool]:
        """Return True for `Monitor`, whose statistics this environment gives itself."""
        return [wrapper_class is Monitor for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Return one picture of each bicycle."""
        pictures = self.envs.render()
        return [None] * self.num_envs if pictures is None else pictures


def _joined(options: Sequence[dict[str, Any]]) -> dict[str, Any] | None:
    """Return the options of N bicycles as those of a vector environment.

    Raises:
        ValueError: if only some bicycles have an option.
    """
    names = {name for one in options for name in one}
    require(
        all(set(one) == names for one in options),
        "set_options needs the same options for every bicycle",
    )
    return {name: [one[name] for one in options] for name in names} or None
