"""Name of `bicycle_sim.task.gym_env` in release 0.1.0; `bicycle_sim` alone is shorter."""

from bicycle_sim.task.gym_env import ENV_ID, BicycleEnv, BicycleVectorEnv

__all__ = ["ENV_ID", "BicycleEnv", "BicycleVectorEnv"]
