"""Names of the environments in Gymnasium's registry."""

from __future__ import annotations

from typing import Any

import gymnasium

from bicycle_sim.task.scenario import SCENARIOS
from bicycle_sim.task.training_variant import TrainingVariant

ENV_ID = "BicycleGoal-v0"
"""Any scenario, by the keyword `scenario`."""

REWARD_THRESHOLDS = {
    "fixed-start-fixed-goal": -670.0,
    "random-start-fixed-goal": -630.0,
    "random-start-random-goal": -600.0,
    "random-small-displacement": -600.0,
    "learning-to-turn": -1900.0,
    "learning-to-turn-fixed-speed": -2000.0,
    "learned-speed": -570.0,
}
"""Mean return from which a scenario counts as solved: a tenth below that of the classical
controller with the displacement (and the pedal) over 300 starts, seed 5."""


def scenario_id(name: str, training: bool = False) -> str:
    """Return the id of one scenario, such as `bicycle/learned-speed-v0`."""
    return f"bicycle/{name}{'-train' if training else ''}-v0"


def env_ids() -> list[str]:
    """Return every id."""
    ids = [scenario_id(name, training) for name in SCENARIOS for training in (False, True)]
    return [ENV_ID, *ids]


def register() -> None:
    """Register `ENV_ID` and two ids for each scenario, once."""
    if ENV_ID in gymnasium.registry:
        return
    _register(ENV_ID, {})
    for name, scenario in SCENARIOS.items():
        steps, short = scenario.max_steps, TrainingVariant().scenario(scenario).max_steps
        _register(scenario_id(name), {"scenario": name}, steps, REWARD_THRESHOLDS.get(name))
        _register(
            scenario_id(name, training=True), {"scenario": name, "variant": "training"}, short
        )


def _register(
    name: str, keywords: dict[str, Any], steps: int | None = None, threshold: float | None = None
) -> None:
    gymnasium.register(
        id=name,
        entry_point="bicycle_sim.task.gym_env:BicycleEnv",
        vector_entry_point="bicycle_sim.task.gym_env:BicycleVectorEnv",
        kwargs=keywords,
        max_episode_steps=steps,
        reward_threshold=threshold,
    )
