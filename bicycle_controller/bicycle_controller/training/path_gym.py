"""Following a path as a Gymnasium environment.

After `import gymnasium`:

    env = gymnasium.make("bicycle_controller.training.path_gym:bicycle/follow-path-v0")
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from bicycle_common.validation import require
from bicycle_controller.control.learned_follower import SCALE
from bicycle_controller.training.path_task import FALL, LONGEST, PathTask
from bicycle_sim.plants import registry

ENV_ID = "bicycle/follow-path-v0"
MOST = 100.0
"""Bound of the scaled observations."""
PENALTY = 12.0
"""Largest penalty of one step that loses nothing."""


class FollowPathEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """Follow a random road with the torque; the pedal keeps to the road's speed profile.

    ## Action space

    `Box(-1, 1, (1,), float32)`: torque on the handlebar as a share of `torque_limit`.

    ## Observation space

    `Box(-100, 100, (18,), float32)`, each number divided by its entry of
    `control.learned_follower.SCALE`: steer angle and rate, lean angle and rate (rad, rad/s, the
    paper's signs), cross-track error (m, positive left of the path) and heading error (rad), speed
    less 3 m/s, and the path's curvature (1/m) here and in the next 2.5 s, every 0.25 s.

    ## Reward

    -(10 min(e, 1)^2 + psi^2 + 0.02 a^2 + 0.05 omega_dot^2) with cross-track error e and heading
    error psi, and 20 less where the ride is lost.

    ## Episode

    Begins upright, beside a road at 0.4 m and 0.15 rad standard deviation. Terminated: it fell, or
    is more than 2 m or 0.8 rad off its road. Truncated: 400 steps of the plant, or the road's end.

    ## Information

    | key         | meaning                                       | unit |
    | ----------- | --------------------------------------------- | ---- |
    | teacher     | torque of the classical follower, as a share  | -    |
    | cross_track | before the next step                          | m    |
    | speed       | the same                                      | m/s  |

    Version history: v0 is the first.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        bicycle: str = "browser-rider",
        plant: str = "whipple",
        roads: int = 200,
        roads_seed: int = 1,
        torque_limit: float = 2.0,
        render_mode: None = None,
    ) -> None:
        """Draw the roads.

        Args:
            bicycle: a name or a YAML file; of no account for the plant choi, which has its own.
            plant: `whipple`, `mujoco` or `choi`.
            roads: number of roads.
            roads_seed: of the roads, which no seed of `reset` changes.
            torque_limit: N m that an action of 1 is.
            render_mode: None; there are no pictures.

        Raises:
            ValueError: on an unknown name or value.
        """
        require(1 <= roads <= 10_000, f"{roads} roads: choose 1 to 10,000")
        self.render_mode = render_mode
        made = registry.named(plant, bicycle if registry.takes_bicycle(plant) else None)
        self._task = PathTask(made, 1, roads_seed, roads, torque_limit=torque_limit)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.observation_space = gymnasium.spaces.Box(-MOST, MOST, SCALE.shape, np.float32)
        self.reward_range = (-FALL - PENALTY, 0.0)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode; `seed` chooses road and start."""
        super().reset(seed=seed)
        self._task.restart(self.np_random)
        return self._seen(self._task.observation), self._info()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Ride one period, 0.025 s.

        Raises:
            ValueError: if the action has a wrong shape or is not finite.
        """
        share = np.asarray(action, dtype=float)
        good = share.shape == (1,) and bool(np.isfinite(share).all())
        require(good, f"the action is {action!r}: give one finite number")
        after, reward, lost, done = self._task.step(share)
        ended = bool(lost[0])
        return (
            self._seen(after),
            float(reward[0]),
            ended,
            bool(done[0]) and not ended,
            self._info(),
        )

    def _seen(self, observation: np.ndarray) -> np.ndarray:
        return np.clip(observation[0], -MOST, MOST).astype(np.float32)

    def _info(self) -> dict[str, Any]:
        """Return what stands in the class's table; after an end, of the next start."""
        seen = self._task.observation[0] * SCALE
        return {
            "teacher": float(self._task.teacher[0]),
            "cross_track": float(seen[4]),
            "speed": float(seen[6] + 3.0),
        }


def register() -> None:
    """Register `ENV_ID`, once."""
    if ENV_ID not in gymnasium.registry:
        gymnasium.register(
            id=ENV_ID,
            entry_point="bicycle_controller.training.path_gym:FollowPathEnv",
            max_episode_steps=LONGEST,
        )


register()
