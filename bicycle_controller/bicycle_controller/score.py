"""How well a policy rides, as the training loop asks: one batched call on fixed starts."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from bicycle_controller.config import EvaluationConfig
from bicycle_controller.evaluate import evaluate
from bicycle_controller.policy import Policy
from bicycle_sim.parameters import Physics
from bicycle_sim.scenario import Scenario


@dataclass(frozen=True)
class Score:
    """Shares of the rides, and the median time of those that reached their goal."""

    reach_rate: float
    fall_rate: float
    orbit_rate: float
    median_time_s: float | None

    @property
    def rank(self) -> tuple[float, float]:
        """What the best policy has most of: goals less falls, then the shorter time."""
        time = float("inf") if self.median_time_s is None else self.median_time_s
        return (self.reach_rate - self.fall_rate, -time)


def score(policy: Policy, scenario: Scenario, physics: Physics, fixed: EvaluationConfig) -> Score:
    """Ride the fixed starts to their end."""
    scenario = dataclasses.replace(scenario, max_steps=fixed.max_steps or scenario.max_steps)
    summary = evaluate(policy, scenario, physics, fixed.episodes, fixed.seed).summary()
    return Score(**{item.name: summary[item.name] for item in dataclasses.fields(Score)})
