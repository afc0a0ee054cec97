"""The names of the environments in Gymnasium's registry."""

from __future__ import annotations

import gymnasium

ENV_ID = "BicycleGoal-v0"


def register() -> None:
    """Register the environments, once."""
    if ENV_ID not in gymnasium.registry:
        gymnasium.register(
            id=ENV_ID,
            entry_point="bicycle_sim.task.gym_env:BicycleEnv",
            vector_entry_point="bicycle_sim.task.gym_env:BicycleVectorEnv",
        )
