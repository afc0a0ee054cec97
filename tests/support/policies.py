"""Policies with random weights, for tests."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from bicycle_controller.policy.policy import Policy, PolicyInfo
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import SCENARIOS

SCALE = (0.8, 3.0, 0.3, 1.0, 5.0, 2.0)


def make_policy(
    seed: int = 0,
    hidden: tuple[int, ...] = (32, 24),
    limits: tuple[float, float, float] = (2.0, 0.2, 0.0),
    norm: bool = False,
    name: str = "random",
) -> Policy:
    rng = np.random.default_rng(seed)
    sizes = [6, *hidden, sum(limit > 0 for limit in limits)]
    tensors = {}
    for index, (inputs, outputs) in enumerate(pairwise(sizes)):
        weight = rng.normal(size=(outputs, inputs)) / np.sqrt(inputs)
        tensors[f"layer.{index}.weight"] = weight.astype(np.float32)
        tensors[f"layer.{index}.bias"] = rng.normal(size=outputs).astype(np.float32)
        if norm and index < len(hidden):
            tensors[f"norm.{index}.weight"] = rng.normal(size=outputs).astype(np.float32)
            tensors[f"norm.{index}.bias"] = rng.normal(size=outputs).astype(np.float32)
    trained = {"algorithm": "none", "seed": seed, "command": "make_policy", "steps": 0}
    scenario = SCENARIOS["random-start-random-goal"]
    return Policy(PolicyInfo(name, scenario, ChoiPlant(), SCALE, limits, trained), tensors)
