"""A policy with memory, of random weights, for tests."""

from __future__ import annotations

import numpy as np

from bicycle_controller.policy.inputs import with_history
from bicycle_controller.policy.policy import Policy, PolicyInfo
from bicycle_sim.plants import registry
from bicycle_sim.task.scenario import SCENARIOS

NOW = ("lean_angle", "lean_rate", "steer_angle", "steer_rate", "heading_error", "speed")
BEFORE = ("lean_rate", "torque")


def make_remembering(
    plant_parameters: tuple[str, ...] = (), periods: int = 3, gain: float = 0.3, seed: int = 0
) -> Policy:
    names = (*with_history(NOW, BEFORE, periods), *plant_parameters)
    rng = np.random.default_rng(seed)
    tensors = {
        "layer.0.weight": rng.normal(size=(16, len(names))).astype(np.float32),
        "layer.0.bias": rng.normal(size=16).astype(np.float32),
        "layer.1.weight": (gain * rng.normal(size=(1, 16))).astype(np.float32),
        "layer.1.bias": np.zeros(1, np.float32),
    }
    info = PolicyInfo(
        "remembering",
        SCENARIOS["random-start-random-goal"],
        registry.named("whipple", "browser-rider"),
        (1.0,) * len(names),
        (7.0, 0.0, 0.0),
        {"seed": seed},
        inputs=names,
        plants=("whipple",),
        speeds=(1.0, 6.0),
    )
    return Policy(info, tensors)
