"""Many bicycles under random actions, as benchmarks step them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from bicycle_sim.plants.base import Plant
from bicycle_sim.task.scenario import named
from bicycle_sim.task.task import BicycleTask


def batched(
    count: int, seed: int = 0, plant: Plant[Any] | None = None, native: bool = False
) -> Callable[[], None]:
    """Step `count` bicycles of one task and restart those that ended, as training does."""
    rng = np.random.default_rng(seed)
    task = BicycleTask(named("random-start-random-goal"), plant, count, rng, native)
    action = rng.normal(size=(count, 3)) * (0.1, 0.01, 0.0)

    def step() -> None:
        found = task.step(action)
        ended = found.fallen | found.terminated | found.truncated
        if ended.any():
            task.reset(ended)

    return step
