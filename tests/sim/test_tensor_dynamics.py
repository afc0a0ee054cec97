"""Bicycles that are stepped by torch ride as those that numpy steps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from bicycle_controller.config import loading
from bicycle_controller.training.factory import make_agent, make_collector, make_memory
from bicycle_sim.plants.base import BodyState
from bicycle_sim.plants.choi import tensor_dynamics
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import named
from bicycle_sim.task.task import BicycleTask

CUDA = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device here")


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda", marks=CUDA)])
@pytest.mark.parametrize("plant", [ChoiPlant(), ChoiPlant.named("corrected")])
@pytest.mark.parametrize("scenario", ["random-start-random-goal", "learned-speed"])
def test_a_task_of_tensors_is_that_of_arrays(scenario: str, plant: ChoiPlant, device: str) -> None:
    tasks = [
        BicycleTask(named(scenario), one, 64, np.random.default_rng(3))
        for one in (plant, plant.on_device(device))
    ]
    source = np.random.default_rng(5)
    limits = tasks[0].scenario.action_limits
    for _ in range(40):
        action = source.uniform(-0.3, 0.3, (64, 3)) * limits
        arrays, tensors = (task.step(action) for task in tasks)
        np.testing.assert_allclose(tensors.observation, arrays.observation, rtol=0, atol=1e-9)
        np.testing.assert_allclose(tensors.reward, arrays.reward, rtol=0, atol=1e-7)
        assert (tensors.fallen == arrays.fallen).all()
        for task in tasks:
            task.reset(arrays.fallen)


def test_training_steps_its_bicycles_on_the_device(monkeypatch: pytest.MonkeyPatch) -> None:
    """No GPU is needed to see that a collector of another device steps there."""
    devices: list[str] = []
    step = tensor_dynamics.step

    def on_the_processor(device: str, *given: Any) -> BodyState:
        devices.append(device)
        return step("cpu", *given)

    monkeypatch.setattr(tensor_dynamics, "step", on_the_processor)
    config = loading.preset("fast", ["bicycles=8", "warm_up=0", "steps=400"])
    memory = make_memory(config, "cpu")
    agent = make_agent(config, "cpu")
    collector = make_collector(config, memory, "cuda")
    for _ in range(10):
        collector.step(agent)
    assert devices == 10 * ["cuda"]
    assert collector.steps == 80
