import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from run_compare import after, assert_same_run, same, state_of
from torch import nn
from training_maker import batch_of, random_replay

from bicycle_controller.agents.naf import Naf, advantage
from bicycle_controller.config import loading
from bicycle_controller.config.algorithms import NafConfig
from bicycle_controller.data.replay_buffer import ReplayBuffer
from bicycle_controller.policy.policy import load_policy
from bicycle_controller.training import checkpoint, online

SMALL = (
    "naf.hidden=[16, 12]",
    "naf.batch=16",
    "naf.capacity=3000",
    "scenario.max_steps=60",
    "starts.max_steps=40",
    "bicycles=8",
    "warm_up=200",
    "steps=1600",
    "log_every=20",
    "evaluation.every=50",
    "evaluation.episodes=8",
    "tensorboard=false",
)


def small_naf(**changes: Any) -> NafConfig:
    config = loading.preset("naf", SMALL).naf
    assert config is not None
    return replace(config, **{"initialisation": "fan_in"} | changes)


def lively(actions: int = 3) -> Naf:
    """Return an agent whose V, mu and L differ widely between states."""
    agent = Naf(small_naf(), actions, 0)
    generator = torch.Generator().manual_seed(5)
    for parameter in agent.network.parameters():
        parameter.data.copy_(0.4 * torch.randn(parameter.shape, generator=generator))
    return agent


def observations(count: int = 200) -> torch.Tensor:
    return torch.randn((count, 6), generator=torch.Generator().manual_seed(1))


def test_p_is_positive_definite_and_l_lower_triangular() -> None:
    _, _, lower = lively().network(0.3 * observations())
    assert torch.equal(lower, torch.tril(lower))
    assert (torch.diagonal(lower, dim1=1, dim2=2) > 0).all()
    assert lower[:, 1, 0].abs().max() > 0.1
    lower = lower.double()
    eigenvalues = torch.linalg.eigvalsh(lower @ lower.mT)
    assert eigenvalues.min() > 0


def test_the_advantage_is_never_positive_and_zero_at_the_policys_action() -> None:
    agent = lively()
    state = 0.3 * observations()
    value, mean, lower = agent.network(state)
    action = 2.0 * torch.rand((200, 3), generator=torch.Generator().manual_seed(2)) - 1.0
    assert (advantage(action - mean, lower) < 0).all()
    assert torch.equal(agent.network.q(state, mean), value)
    assert (agent.network.q(state, action) < value).all()
    assert np.allclose(agent.act((state * agent.scale).numpy()), mean.detach().numpy(), atol=1e-6)


def test_the_advantage_by_hand() -> None:
    # L = [[2, 0], [1, 3]], a - mu = (0.5, -1): L^T (a - mu) = (1 - 1, -3), A = -9 / 2; the same
    # from P = L L^T = [[4, 2], [2, 10]]: -(4 / 4 - 2 + 10) / 2.
    lower = torch.tensor([[[2.0, 0.0], [1.0, 3.0]]])
    assert advantage(torch.tensor([[0.5, -1.0]]), lower).tolist() == [-4.5]


def hand_worked_agent() -> Naf:
    """Return one hidden unit, which is the first observation / 2."""
    config = small_naf(hidden=(1,), batch=1, tau=0.25, learning_rate=0.01, reward_scale=0.5)
    agent = Naf(replace(config, observation_scale=(2.0, 1, 1, 1, 1, 1)), 2, 0)
    for network in (agent.network, agent.target):
        assign(network.actor, [[1.0, 0, 0, 0, 0, 0]], [0.0], [[0.0], [0.0]], [0.0, 0.0])
        assign(network.value, [[-3.0]], [1.0])
        assign(network.entries, [[0.0], [1.0], [0.0]], [math.log(2.0), 0.0, math.log(3.0)])
    return agent


def assign(network: nn.Module, *values: Any) -> None:
    for parameter, value in zip(network.parameters(), values, strict=True):
        parameter.data.copy_(torch.tensor(value))


def test_q_and_its_target_by_hand() -> None:
    agent = hand_worked_agent()
    # The hidden unit is 2 / 2 = 1: V = -3 + 1, mu = 0, L = [[2, 0], [1, 3]]. With a = (0.5, -1)
    # the advantage is -4.5 as above.
    observation, action = torch.tensor([[1.0, 0, 0, 0, 0, 0]]), torch.tensor([[0.5, -1.0]])
    value, mean, lower = agent.network(observation)
    assert (value.tolist(), mean.tolist()) == ([-2.0], [[0.0, 0.0]])
    assert torch.allclose(lower, torch.tensor([[[2.0, 0.0], [1.0, 3.0]]]))
    assert agent.network.q(observation, action).tolist() == pytest.approx([-6.5])
    # y = 0.5 * -4 + 0.9 V'(s') with V' = -3 * 4 / 2 + 1 = -5; 0 where nothing follows.
    batch = batch_of(
        [[2.0, 0, 0, 0, 0, 0]] * 2,
        [[0.5, -1.0]] * 2,
        [-4.0, -4.0],
        [0.9, 0.0],
        [[4.0, 0, 0, 0, 0, 0]] * 2,
    )
    assert agent.targets(batch).tolist() == pytest.approx([-6.5, -2.0])


def test_one_update_by_hand() -> None:
    agent = hand_worked_agent()
    agent.update_on(batch_of([[2.0, 0, 0, 0, 0, 0]], [[0.5, -1.0]], [-4.0], [0.0]))
    # Q - y = -6.5 + 2 = -4.5, so the loss's slope by Q is -9, and V's bias has it; mu's biases
    # have -9 P (a - mu) = -9 (0, -9).
    network: Any = agent.network
    target: Any = agent.target
    assert network.value.layers[0].bias.grad.tolist() == pytest.approx([-9.0])
    mean = network.actor.layers[-1].bias.grad.tolist()
    assert mean == pytest.approx([0.0, 81.0], abs=1e-4)
    # u = L^T (a - mu) = (0, -3). dA/dL_ij = -(a - mu)_i u_j: L_11 0, L_21 0, L_22 -(-1)(-3) = -3,
    # and by its logarithm 3 * -3 = -9; times -9 it is 81.
    assert network.entries.bias.grad.tolist() == pytest.approx([0.0, 0.0, 81.0], abs=1e-4)
    # Adam's first step is the learning rate, against the slope; a quarter of it enters V'.
    assert network.value.layers[0].bias.item() == pytest.approx(1.01, abs=1e-6)
    assert target.value.layers[0].bias.item() == pytest.approx(1.0025, abs=1e-6)


def test_it_finds_the_best_actions_of_a_one_step_problem() -> None:
    rng = np.random.default_rng(0)
    action = rng.uniform(-1, 1, (2000, 2))
    reward = -((action[:, :1] - 0.4) ** 2) - (action[:, 1:] + 0.2) ** 2
    observation = rng.normal(size=(2000, 6))
    replay = ReplayBuffer(2000, 2)
    columns = [observation, action, observation, reward, np.zeros((2000, 4))]
    replay.add(np.concatenate(columns, axis=1))
    agent = Naf(small_naf(hidden=(32, 32), batch=64, reward_scale=1.0), 2, 0)
    best = np.array([0.4, -0.2])
    assert np.abs(agent.act(observation) - best).mean() > 0.2
    agent.update(replay, 1500)
    assert np.abs(agent.act(observation) - best).mean() < 0.05
    # A = -1/2 (a - mu)^T P (a - mu), so P must be twice the identity.
    scaled = torch.as_tensor(observation[:500], dtype=torch.float32) / agent.scale
    lower = agent.network(scaled)[2].detach()
    assert torch.allclose((lower @ lower.mT).mean(0), 2.0 * torch.eye(2), atol=0.2)


def test_the_gradient_is_clipped() -> None:
    free, clipped = (Naf(small_naf(grad_clip=limit), 2, 0) for limit in (0.0, 1e-3))
    for agent in (free, clipped):
        agent.update(random_replay(2), 1)
    norms = []
    for agent in (free, clipped):
        gradients: list[Any] = [parameter.grad for parameter in agent.network.parameters()]
        norms.append(math.sqrt(sum(float(g.square().sum()) for g in gradients)))
    assert norms[0] > 0.01
    assert norms[1] == pytest.approx(1e-3, rel=1e-3)


def test_the_learning_rate_falls_in_a_straight_line() -> None:
    agent = Naf(small_naf(learning_rate=0.1, learning_rate_end=0.2), 2, 0)
    for progress, rate in ((0.0, 0.1), (0.5, 0.06), (1.0, 0.02), (1.5, 0.02)):
        agent.anneal(progress)
        assert agent.optimiser.param_groups[0]["lr"] == pytest.approx(rate)


def test_a_saved_agent_goes_on_to_the_bit(tmp_path: Path) -> None:
    replay = random_replay(2)
    agent, other = Naf(small_naf(), 2, 0), Naf(small_naf(), 2, 77)
    agent.update(replay, 5)
    checkpoint.save(tmp_path / "state.pt", agent.state_dict())
    other.load_state_dict(checkpoint.load(tmp_path / "state.pt"))
    for learner in (agent, other):
        learner.update(replay, 5)
    states = []
    for learner in (agent, other):
        checkpoint.save(tmp_path / "state.pt", learner.state_dict())
        states.append(checkpoint.load(tmp_path / "state.pt"))
    assert same(*states)
    assert agent.metrics() == other.metrics()


def test_a_resumed_run_gives_the_same_numbers_to_the_bit(tmp_path: Path) -> None:
    config = loading.preset("naf", [*SMALL, "naf.n_step=3", "naf.grad_clip=1"])
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    assert online.run(config, whole).updates == 176
    assert online.run(config, parts, stop=after(70)).status == "interrupted"
    assert online.resume(parts).status == "finished"
    assert_same_run(whole, parts)


def test_a_seed_repeats_a_run_and_another_does_not(tmp_path: Path) -> None:
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        config = loading.preset("naf", [*SMALL, f"seed={seed}", "steps=600"])
        online.run(config, tmp_path / name)
    assert_same_run(tmp_path / "a", tmp_path / "b")
    assert not same(state_of(tmp_path / "a")["agent"], state_of(tmp_path / "c")["agent"])


def test_the_deployed_policy_is_mu(tmp_path: Path) -> None:
    config = loading.preset("naf", SMALL)
    online.run(config, tmp_path / "run")
    policy = load_policy(tmp_path / "run" / "last.safetensors")
    agent = Naf(small_naf(initialisation="output"), 2, 99)
    agent.load_state_dict(state_of(tmp_path / "run")["agent"])
    raw = np.random.default_rng(0).normal(size=(50, 6))
    limits = config.scenario.action_limits
    expected = np.column_stack([agent.act(raw) * limits[:2], np.zeros(50)])
    assert np.allclose(policy.act(raw), expected, atol=1e-6)
    assert policy.info.trained["algorithm"] == "naf"
