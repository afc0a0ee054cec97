"""Policies with random weights, for tests."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from bicycle_controller.policy.policy import Policy, PolicyInfo, load_policy
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import SCENARIOS


def own_policy(name: str = "mine", wear: float = 0.0) -> Policy:
    """Return a policy that rides, under a name of its own; `wear` changes its last bias."""
    shipped = load_policy("fixed-speed")
    tensors = {key: tensor.copy() for key, tensor in shipped.tensors.items()}
    last = max(key for key in tensors if key.endswith("bias"))
    tensors[last] += np.float32(wear)
    return Policy(replace(shipped.info, name=name), tensors)


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
