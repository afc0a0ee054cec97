"""Every tensor of a learner and of the bicycles is on the device that was asked for.

No GPU is needed: torch's `meta` device has no numbers, but refuses to meet a tensor of the CPU
just as a GPU does. What the numbers are on a GPU, test_cuda.py looks at where there is one.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import pytest
import torch

from bicycle_controller.agents.ddpg import Ddpg
from bicycle_controller.agents.naf import Naf
from bicycle_controller.config import loading
from bicycle_controller.data.replay_buffer import ReplayBuffer
from bicycle_controller.training.factory import make_agent, make_memory
from bicycle_sim.plants.choi import dynamics
from bicycle_sim.plants.choi.dynamics import State
from bicycle_sim.plants.choi.parameters import Physics

DEVICE = "meta"
LEARNERS = ("paper", "authors", "fast", "guided", "guided-speed", "offline", "naf")


class CpuGenerator(torch.Generator):
    """Generator on the CPU, whatever device was asked for."""

    def __new__(cls, *_: object) -> CpuGenerator:
        return super().__new__(cls)


@pytest.fixture(autouse=True)
def _allow_meta(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let torch's parts for CPU and GPUs only work here: generators, and Adam in one kernel."""
    adam = torch.optim.Adam
    monkeypatch.setattr(torch, "Generator", CpuGenerator)
    monkeypatch.setattr(
        torch.optim, "Adam", lambda *args, **options: adam(*args, **options | {"fused": False})
    )


def learner(preset: str, *changes: str) -> tuple[Ddpg | Naf, ReplayBuffer]:
    config = loading.preset(preset, [*changes])
    agent, memory = make_agent(config, DEVICE), make_memory(config, DEVICE)
    assert isinstance(agent, (Ddpg, Naf))
    assert isinstance(memory, ReplayBuffer)
    memory.size = memory.capacity
    return agent, memory


@pytest.mark.parametrize("preset", LEARNERS)
def test_an_update_stays_on_the_device(preset: str) -> None:
    agent, memory = learner(preset)
    agent.update(memory, 2)


@pytest.mark.parametrize("preset", ["paper", "fast", "guided"])
def test_so_does_the_reference(preset: str) -> None:
    agent, memory = learner(preset, "ddpg.backend=autograd")
    agent.update(memory, 2)


def test_a_tensor_left_behind_is_noticed() -> None:
    agent, memory = learner("paper")
    assert isinstance(agent, Ddpg)
    agent.scale = torch.ones(6)
    with pytest.raises(RuntimeError, match="device"):
        agent.update(memory, 1)


@pytest.mark.parametrize("physics", [Physics(), Physics.named("corrected")])
def test_bicycles_stay_on_the_device(physics: Physics) -> None:
    there = torch.zeros(5, dtype=torch.float64, device=DEVICE)
    tensors: dict[str, Any] = {field.name: there for field in fields(State)}
    state = State(**tensors)
    moved = dynamics.step(state, there, there, there, physics, (1.0, 5.0), torch)
    assert {(value.device.type, value.dtype) for value in vars(moved).values()} == {
        (DEVICE, torch.float64)
    }
