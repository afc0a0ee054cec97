"""N bicycles as one Gymnasium vector environment, in one array program."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from bicycle_common.validation import nearest, require
from bicycle_sim.plants.base import Plant
from bicycle_sim.task import env_options
from bicycle_sim.task.env_core import (
    DISCOUNT,
    METADATA,
    EnvConfig,
    EnvCore,
    EnvProperties,
    Info,
    checked_mode,
    new_renderers,
)
from bicycle_sim.task.env_options import ResetOptions
from bicycle_sim.task.scenario import Scenario
from bicycle_sim.task.training_variant import TrainingVariant

if TYPE_CHECKING:
    from bicycle_sim.task.picture_page import PicturePage
    from bicycle_sim.task.render import Renderer

Seeds = int | Sequence[int | None] | None


class BicycleVectorEnv(EnvProperties, VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """N bicycles in one array program; each as in `BicycleEnv`.

    Bicycle i is the `BicycleEnv` that is seeded with `seed + i`, or with `seed[i]`, to the bit.
    Ended episodes begin again as `autoreset_mode` says, which is Gymnasium's:

    - `NEXT_STEP`, the default: in the next step, which ignores its action and returns a reward of
      zero for it.
    - `SAME_STEP`: at once; the last observation and information are `info["final_obs"]` (objects)
      and `info["final_info"]`.
    - `DISABLED`: by `reset(options={"reset_mask": ended})`.
    """

    metadata: dict[str, Any] = METADATA | {"autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        num_envs: int = 1,
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
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
    ) -> None:
        """Create `num_envs` bicycles; see `BicycleEnv` for the other arguments.

        Raises:
            ValueError: on an unknown name or value.
        """
        self.render_mode = checked_mode(render_mode)
        self.num_envs = num_envs
        self.autoreset_mode = _mode(autoreset_mode)
        self.metadata = METADATA | {"autoreset_mode": self.autoreset_mode}
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
        self._core = EnvCore(config, num_envs)
        self.single_action_space = self._core.action_space
        self.single_observation_space = self._core.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._ended = np.zeros(num_envs, dtype=bool)
        self._all = np.ones(num_envs, dtype=bool)
        self._seeds: tuple[int | None, ...] = (None,) * num_envs
        self._renderers: list[Renderer] = []
        self._page: PicturePage | None = None

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """Generator of each bicycle."""
        self._ensure_seeded()
        return tuple(self._core.rngs)

    @property
    def np_random_seed(self) -> tuple[int | None, ...]:  # type: ignore[override]
        """Seed of each bicycle's generator; None if it was not seeded."""
        return self._seeds

    def reset(
        self, *, seed: Seeds = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode for every bicycle, or for those of the option `reset_mask`.

        Args:
            seed: of bicycle 0, one more for each that follows; or one for each.
            options: `start`, `goal`, `heading`, `speed`, `reset_mask`; see `env_options.read`.

        Raises:
            ValueError: on an unknown option or value, or a wrong number of seeds.
        """
        chosen = env_options.read(options, self.num_envs, self.task.scenario, many=True)
        mask = self._all if chosen.mask is None else chosen.mask
        self._seed(seed, mask)
        self._begin(mask, chosen)
        self._show()
        return self._core.observe(), _masked(self._core.info(), mask)

    def render(self) -> tuple[np.ndarray, ...] | None:
        """Return one picture for each bicycle, or None without `rgb_array`."""
        if self.render_mode != "rgb_array":
            return None
        self._renderers = self._renderers or new_renderers(self.num_envs)
        return self._core.render(self._renderers)

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Step every bicycle, and restart those whose episode ended as the mode says.

        Raises:
            ValueError: if an action is not finite, or an ended episode was not reset.
        """
        mode, fresh = self.autoreset_mode, self._ended
        if mode is AutoresetMode.DISABLED and fresh.any():
            raise ValueError(
                'some episodes have ended: call reset(options={"reset_mask": ended}) first'
            )
        observation, reward, ended, step = self._core.step(actions, resting=fresh)
        truncated = step.truncated & ~ended
        info = self._core.info(step)
        extra: dict[str, Any] = {}
        if fresh.any():  # NEXT_STEP
            ended, truncated = ended & ~fresh, truncated & ~fresh
            reward[fresh] = 0.0
            observation, info = self._begun(fresh, observation, info)
        self._ended = ended | truncated
        if mode is AutoresetMode.SAME_STEP and self._ended.any():
            fresh = self._ended
            extra = _final(observation, info, fresh)
            observation, info = self._begun(fresh, observation, info)
        self._show()
        return observation, reward, ended, truncated, _masked(info, self._all) | extra

    def _begun(
        self, fresh: np.ndarray, observation: np.ndarray, info: Info
    ) -> tuple[np.ndarray, Info]:
        """Begin episodes; return observation and information with theirs in place."""
        self._begin(fresh, ResetOptions())
        observation = np.where(fresh[:, None], self._core.observe(), observation)
        begun = self._core.info()
        return observation, {
            name: np.where(fresh, begun[name], value) for name, value in info.items()
        }

    def _begin(self, mask: np.ndarray, options: ResetOptions) -> None:
        self._ensure_seeded()
        self._core.begin(mask, options)
        self._ended = self._ended & ~mask
        for index in np.flatnonzero(mask[: len(self._renderers)]):
            self._renderers[index].clear()

    def _seed(self, seed: Seeds, mask: np.ndarray) -> None:
        """Seed the bicycles of `mask`."""
        if seed is None:
            return
        if isinstance(seed, (int, np.integer)):
            seeds: list[int | None] = [int(seed) + index for index in range(self.num_envs)]
        else:
            seeds = [one if one is None else int(one) for one in seed]
        require(
            len(seeds) == self.num_envs,
            f"seed must be a number or {self.num_envs} of them, not {len(seeds)}",
        )
        self._ensure_seeded()
        rngs, known = list(self._core.rngs), list(self._seeds)
        for index in np.flatnonzero(mask):
            if seeds[index] is not None:
                rngs[index], known[index] = seeding.np_random(seeds[index])[0], seeds[index]
        self._core.seed(rngs)
        self._seeds = tuple(known)

    def _ensure_seeded(self) -> None:
        if not self._core.rngs:
            children = np.random.SeedSequence().spawn(self.num_envs)
            self._core.seed([np.random.default_rng(child) for child in children])

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Return what a method of each bicycle returns, or the value of an attribute.

        Raises:
            ValueError: for a method that only all bicycles together have.
        """
        require(
            name not in ("reset", "step"),
            f"call({name!r}) steps single bicycles: use {name} of the vector environment",
        )
        found = self.render() if name == "render" else None
        if found is not None:
            return found
        value = getattr(self, name, None)
        if callable(value):
            return (value(*args, **kwargs),) * self.num_envs
        return self.get_attr(name)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of each bicycle, as `BicycleEnv` has it.

        Raises:
            AttributeError: on an unknown name.
        """
        each: dict[str, Callable[[], Sequence[Any]]] = {
            "goal": lambda: [tuple(goal) for goal in self._core.goals().tolist()],
            "np_random": lambda: self.np_random,
            "np_random_seed": lambda: self.np_random_seed,
            "action_space": lambda: [self.single_action_space] * self.num_envs,
            "observation_space": lambda: [self.single_observation_space] * self.num_envs,
        }
        if name in each:
            return tuple(each[name]())
        return (getattr(self, name),) * self.num_envs

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of each bicycle: `goal`, one (x, y) for all or one for each.

        Raises:
            ValueError: on another attribute or a wrong shape.
        """
        require(
            name == "goal",
            f"{name!r} cannot be set{nearest(name, ('goal',))}; a vector environment has: goal",
        )
        chosen = env_options.read({"goal": values}, self.num_envs, self.scenario, many=True)
        assert chosen.goal is not None
        self._core.set_goals(chosen.goal)

    def close_extras(self, **kwargs: Any) -> None:
        """Close the page of `human`."""
        if self._page is not None:
            self._page.close()
            self._page = None

    def _show(self) -> None:
        """Show bicycle 0 on the page of `human` and keep to real time."""
        if self.render_mode != "human":
            return
        if self._page is None:
            from bicycle_sim.task.picture_page import PicturePage

            self._page = PicturePage(self.task.plant.time_step)
        self._renderers = self._renderers or new_renderers(1)
        self._page.show(lambda: self._core.render(self._renderers)[0])


def _mode(mode: str | AutoresetMode) -> AutoresetMode:
    """Return Gymnasium's mode, from its name or value too."""
    if isinstance(mode, AutoresetMode):
        return mode
    for known in AutoresetMode:
        if mode in (known.value, known.name):
            return known
    names = ", ".join(known.name for known in AutoresetMode)
    raise ValueError(f"autoreset_mode must be one of {names}, not {mode!r}")


def _masked(info: Info, mask: np.ndarray) -> dict[str, Any]:
    """Return the same with Gymnasium's masks, which mark the bicycles with a value."""
    return info | {f"_{name}": mask.copy() for name in info}


def _final(observation: np.ndarray, info: Info, ended: np.ndarray) -> dict[str, Any]:
    """Return the last observations and information of the episodes that `ended`."""
    last = np.full(len(ended), None, dtype=object)
    for index in np.flatnonzero(ended):
        last[index] = observation[index].copy()
    return {
        "final_obs": last,
        "_final_obs": ended.copy(),
        "final_info": _masked({name: value.copy() for name, value in info.items()}, ended),
        "_final_info": ended.copy(),
    }
