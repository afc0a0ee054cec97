"""The actor taken apart gives the bits of the actor called."""

from typing import Any

import numpy as np
import pytest
import torch

from bicycle_controller.agents.answer import Answer
from bicycle_controller.agents.networks import Actor

KINDS: dict[str, dict[str, Any]] = {
    "plain": {},
    "norm": {"layer_norm": True},
    "symmetric": {"symmetric": True},
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("count", [1, 2, 16, 129])
def test_it_gives_the_bits_of_the_actor(kind: str, count: int) -> None:
    torch.manual_seed(count)
    actor = Actor(6, [400, 300], 3, **KINDS[kind])
    scale = torch.rand(6) + 0.1
    answer = Answer(actor, scale)
    assert answer._plain == (kind == "plain")
    observation = np.random.default_rng(count).normal(size=(count, 6))
    before = observation.copy()
    with torch.no_grad():
        wanted = actor(torch.as_tensor(observation, dtype=torch.float32) / scale).numpy()
        result = answer(observation)
        assert result.tobytes() == wanted.tobytes()
        for parameter in actor.parameters():
            parameter.add_(0.01 * torch.randn_like(parameter))
    assert not np.array_equal(answer(observation), result)
    assert np.array_equal(observation, before)
