import math
from typing import Any

import numpy as np
import pytest
import torch
from training_maker import ddpg_of

from bicycle_controller.agents.networks import (
    Actor,
    Critic,
    initialise,
    linear_layers,
    policy_tensors,
)
from bicycle_controller.config import loading
from bicycle_controller.policy.policy import Policy, PolicyInfo
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import SCENARIOS


def built(preset: str, actions: int = 3) -> tuple[Actor, Critic]:
    config = ddpg_of(loading.preset(preset))
    generator = torch.Generator().manual_seed(0)
    actor = Actor(6, config.actor_hidden, actions, config.actor_layer_norm)
    critic = Critic(6, config.critic_hidden, actions, config.action_layer)
    for network in (actor, critic):
        initialise(network, config.initialisation, generator)
    return actor, critic


def shapes(network: Actor | Critic) -> list[tuple[int, ...]]:
    return [tuple(layer.weight.shape) for layer in linear_layers(network)]


@pytest.mark.parametrize(
    ("preset", "critic"),
    [
        ("paper", [(200, 6), (200, 203), (1, 200)]),
        ("authors", [(400, 6), (300, 403), (1, 300)]),
    ],
)
def test_rows_27_and_28_sizes_and_the_action_at_the_second_layer(
    preset: str, critic: list[tuple[int, int]]
) -> None:
    networks = built(preset)
    assert shapes(networks[0]) == [(400, 6), (300, 400), (3, 300)]
    assert shapes(networks[1]) == critic


def test_row_30_literally_every_parameter_starts_within_3e_3() -> None:
    for network in built("paper"):
        for parameter in network.parameters():
            assert parameter.abs().max() <= 3e-3
            assert parameter.numel() == 1 or parameter.abs().max() > 1e-4


def test_row_30_as_the_authors_ran_it_only_the_output_does() -> None:
    for network in built("authors"):
        *hidden, output = linear_layers(network)
        assert max(output.weight.abs().max(), output.bias.abs().max()) <= 3e-3
        for layer in hidden:
            limit = math.sqrt(6 / sum(layer.weight.shape))
            assert 0.95 * limit < layer.weight.abs().max() <= limit
            assert not layer.bias.any()


def test_fan_in_start_lies_within_one_over_the_root_of_the_inputs() -> None:
    actor = Actor(6, [50], 2)
    initialise(actor, "fan_in", torch.Generator().manual_seed(0))
    assert 0.95 / math.sqrt(6) < linear_layers(actor)[0].weight.abs().max() <= 1 / math.sqrt(6)
    assert linear_layers(actor)[1].weight.abs().max() <= 3e-3


def test_a_start_is_its_seeds_alone() -> None:
    first, second = built("authors"), built("authors")
    pairs = zip(first[0].parameters(), second[0].parameters(), strict=True)
    assert all(torch.equal(a, b) for a, b in pairs)


def test_the_critic_by_hand() -> None:
    critic = Critic(6, [1, 1], 1, action_layer=2)
    values = {
        "layers.0.weight": [[2.0, 0, 0, 0, 0, 0]],
        "layers.0.bias": [1.0],
        "layers.1.weight": [[3.0, -4.0]],
        "layers.1.bias": [0.5],
        "layers.2.weight": [[-2.0]],
        "layers.2.bias": [7.0],
    }
    critic.load_state_dict({name: torch.tensor(value) for name, value in values.items()})
    observation = torch.tensor([[0.5, 9, 9, 9, 9, 9], [-9.0, 9, 9, 9, 9, 9]])
    # 0.5 -> relu(2 * 0.5 + 1) = 2 -> relu(3 * 2 - 4 * 0.25 + 0.5) = 5.5 -> 7 - 11 = -4;
    # -9 -> 0 -> relu(0 + 4 + 0.5) = 4.5 -> 7 - 9 = -2.
    values = critic(observation, torch.tensor([[0.25], [-1.0]]))
    assert values.tolist() == [-4.0, -2.0]


@pytest.mark.parametrize("switch", [{}, {"layer_norm": True}, {"symmetric": True}])
def test_the_policy_file_holds_the_same_actor(switch: dict[str, Any]) -> None:
    actor = Actor(6, [20, 10], 2, **switch)
    scale = (0.8, 3.0, 0.3, 1.0, 5.0, 2.0)
    limits = (2.0, 0.2, 0.0)
    info = PolicyInfo("x", SCENARIOS["random-start-random-goal"], ChoiPlant(), scale, limits)
    policy = Policy(info, policy_tensors(actor))
    observation = np.random.default_rng(0).normal(size=(50, 6)) * scale
    with torch.no_grad():
        scaled = torch.tensor(observation / scale, dtype=torch.float32)
        expected = actor(scaled).numpy() * (2.0, 0.2)
    assert np.allclose(policy.act(observation)[:, :2], expected, atol=1e-6)
    assert np.ptp(expected, axis=0).min() > 0.01


def test_a_symmetric_actor_by_hand() -> None:
    actor = Actor(1, [1], 3, symmetric=True)
    values = {
        "layers.0.weight": [[2.0]],
        "layers.0.bias": [1.0],
        "layers.1.weight": [[1.0], [3.0], [5.0]],
        "layers.1.bias": [0.5, 0.5, 0.5],
    }
    actor.load_state_dict({name: torch.tensor(value) for name, value in values.items()})
    # Seen 1 gives hidden relu(3) = 3, mirrored -1 gives relu(-1) = 0. Torque and displacement
    # take half the difference of 3 + 0.5 and 0.5, the pedal half the sum of 15.5 and 0.5.
    assert actor.raw(torch.tensor([[1.0]])).tolist() == [[1.5, 4.5, 8.0]]
    assert actor.raw(torch.tensor([[-1.0]])).tolist() == [[-1.5, -4.5, 8.0]]
