"""Names of the environments in Gymnasium's registry."""

from __future__ import annotations

import gymnasium

from bicycle_sim.task.scenario import SCENARIOS

ENV_ID = "BicycleGoal-v0"
"""Any scenario, by the keyword `scenario`."""


def scenario_id(name: str) -> str:
    """Return the id of one scenario, such as `bicycle/learned-speed-v0`."""
    return f"bicycle/{name}-v0"


def register() -> None:
    """Register `ENV_ID` and an id for each scenario, once."""
    if ENV_ID in gymnasium.registry:
        return
    ids: dict[str, dict[str, str]] = {ENV_ID: {}} | {
        scenario_id(name): {"scenario": name} for name in SCENARIOS
    }
    for name, keywords in ids.items():
        gymnasium.register(
            id=name,
            entry_point="bicycle_sim.task.gym_env:BicycleEnv",
            vector_entry_point="bicycle_sim.task.gym_env:BicycleVectorEnv",
            kwargs=keywords,
        )
