"""The mirrored actor: left is right, and its policy file is a plain network."""

from __future__ import annotations

import numpy as np
import torch
from policies import SCALE

from bicycle_controller.agents.mirrored import MirroredActor
from bicycle_controller.policy.policy import Policy, PolicyInfo
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import SCENARIOS

MIRROR = [-1.0, -1.0, -1.0, -1.0, 1.0, -1.0]


def test_a_mirrored_state_gets_the_mirrored_action() -> None:
    torch.manual_seed(1)
    actor = MirroredActor(MIRROR, (16, 8))
    seen = torch.randn(20, 6)
    with torch.no_grad():
        actions = actor(seen)
        torch.testing.assert_close(actor(seen * torch.tensor(MIRROR)), -actions)
    assert float(actions.abs().max()) > 0.001


def test_its_file_answers_alike() -> None:
    torch.manual_seed(2)
    actor = MirroredActor(MIRROR, (16, 8))
    info = PolicyInfo(
        "mirrored", SCENARIOS["fixed-start-fixed-goal"], ChoiPlant(), SCALE, (5.0, 0.0, 0.0)
    )
    policy = Policy(info, actor.tensors())
    seen = np.random.default_rng(0).normal(size=(30, 6))
    with torch.no_grad():
        expected = actor(torch.as_tensor(seen / SCALE, dtype=torch.float32)).numpy()
    np.testing.assert_allclose(policy.act(seen)[:, 0], 5.0 * expected, atol=1e-5)
    np.testing.assert_allclose(policy.act(seen[:1])[0, 0], 5.0 * expected[0], atol=1e-5)
