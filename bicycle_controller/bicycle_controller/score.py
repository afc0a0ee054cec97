"""How well a policy rides, as the training loop asks: one batched call on fixed starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bicycle_controller.policy import Policy
from bicycle_sim.parameters import Physics
from bicycle_sim.scenario import Scenario
from bicycle_sim.task import BicycleTask


@dataclass(frozen=True)
class Score:
    """Shares of episodes and the median time of those that reached their goal."""

    reach_rate: float
    fall_rate: float
    median_time: float
    """s; infinite where no goal was reached."""

    @property
    def rank(self) -> tuple[float, float]:
        """What the best policy has most of: goals less falls, then the shorter time."""
        return (self.reach_rate - self.fall_rate, -self.median_time)


def score(policy: Policy, scenario: Scenario, physics: Physics, episodes: int, seed: int) -> Score:
    """Ride `episodes` starts drawn from `seed` to their end, all at once."""
    task = BicycleTask(scenario, physics, episodes, np.random.default_rng(seed))
    observation = task.observation()
    riding = np.ones(episodes, dtype=bool)
    reached = np.zeros(episodes, dtype=bool)
    fallen = np.zeros(episodes, dtype=bool)
    ended_at = np.zeros(episodes, dtype=np.int64)
    action = np.zeros((episodes, 3))
    while riding.any():
        action[riding] = policy.act(observation[riding])
        step = task.step(action)
        reached |= riding & step.terminated
        fallen |= riding & step.fallen
        ended = riding & (step.terminated | step.truncated | step.fallen)
        ended_at[ended] = task.steps[ended]
        riding &= ~ended
        observation = step.observation
    time = np.median(ended_at[reached]) if reached.any() else np.inf
    seconds = float(time) * physics.constants.time_step
    return Score(float(reached.mean()), float(fallen.mean()), seconds)
