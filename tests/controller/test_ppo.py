import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from run_compare import after, assert_same_run, rows, same, state_of

from bicycle_controller.agents.ppo import Ppo, Samples, clipped_objective
from bicycle_controller.config import loading
from bicycle_controller.config.algorithms import PpoConfig
from bicycle_controller.config.run import RunConfig
from bicycle_controller.data.rollout_buffer import RolloutBuffer
from bicycle_controller.policy.policy import load_policy
from bicycle_controller.training import checkpoint, online
from bicycle_controller.training.factory import make_agent, make_collector

SMALL = (
    "ppo.hidden=[16, 12]",
    "ppo.rollout=20",
    "ppo.batch=32",
    "ppo.epochs=3",
    "scenario.max_steps=60",
    "starts.max_steps=30",
    "bicycles=8",
    "steps=1600",
    "log_every=20",
    "evaluation.every=50",
    "evaluation.episodes=8",
    "tensorboard=false",
)


def small_run(*overrides: str) -> RunConfig:
    return loading.preset("ppo", [*SMALL, *overrides])


def small_ppo(**changes: Any) -> PpoConfig:
    config = small_run().ppo
    assert config is not None
    return replace(config, **changes)


def rollout_of(rounds: int, count: int, actions: int = 1) -> RolloutBuffer:
    """Return a full rollout of random transitions in which nothing ends."""
    rng = np.random.default_rng(0)
    rollout = RolloutBuffer(rounds, count, actions)
    for _ in range(rounds):
        parts = [rng.normal(size=(count, width)) for width in (6, actions, 6, 1)]
        flags = np.tile([0.99, 0.0, 0.0, 0.0], (count, 1))
        rollout.add(np.concatenate([*parts, flags], axis=1).astype(np.float32))
    return rollout


@pytest.mark.parametrize(
    ("ratio", "advantage", "objective", "slope"),
    [
        (1.1, 2.0, 2.2, 2.0),  # within the interval
        (1.5, 2.0, 2.4, 0.0),  # better already: no more to gain
        (0.5, 2.0, 1.0, 2.0),  # worse: the way back counts in full
        (1.5, -2.0, -3.0, -2.0),
        (0.5, -2.0, -1.6, 0.0),
        (0.9, -2.0, -1.8, -2.0),
    ],
)
def test_the_clipped_objective_by_hand(
    ratio: float, advantage: float, objective: float, slope: float
) -> None:
    x = torch.tensor([ratio], requires_grad=True)
    found = clipped_objective(x, torch.tensor([advantage]), 0.2)
    found.backward()  # type: ignore[no-untyped-call]
    assert found.item() == pytest.approx(objective)
    assert x.grad is not None
    assert x.grad.item() == pytest.approx(slope)


def still(**changes: Any) -> Ppo:
    """Return one action, whose mean is 0 everywhere, and V = -2."""
    agent = Ppo(small_ppo(**changes), 1, 0)
    for network in (agent.network.actor, agent.network.value):
        for parameter in network.parameters():
            parameter.data.zero_()
    value: Any = agent.network.value
    value.layers[-1].bias.data.fill_(-2.0)
    return agent


def test_the_whole_objective_by_hand() -> None:
    agent = still(
        normalise_advantages=False, value_weight=0.5, entropy_weight=0.1, log_std=math.log(0.5)
    )
    # N(0, 0.5) at 0.5: log density -0.5 - log 0.5 - 0.5 log 2 pi.
    log_density = -0.5 - math.log(0.5) - 0.5 * math.log(2.0 * math.pi)
    samples = Samples(
        observation=torch.zeros(2, 6),
        action=torch.full((2, 1), 0.5),
        log_probability=torch.tensor([log_density - math.log(1.5), log_density - math.log(0.5)]),
        advantage=torch.tensor([2.0, 2.0]),
        value_target=torch.tensor([-1.0, -5.0]),
    )
    # Ratios 1.5 and 0.5 give 2.4 and 1; the values' squared errors are 1 and 9; the entropy is
    # 0.5 log(2 pi e 0.25).
    entropy = 0.5 * math.log(2.0 * math.pi * math.e * 0.25)
    expected = (2.4 + 1.0) / 2 - 0.5 * (1.0 + 9.0) / 2 + 0.1 * entropy
    assert agent.objective(samples).item() == pytest.approx(expected, rel=1e-5)
    found = agent.metrics()
    assert found["value_loss"] == pytest.approx(5.0)
    assert found["entropy"] == pytest.approx(entropy, rel=1e-5)
    assert found["clipped"] == 1.0


def test_densities_and_entropy_equal_torchs() -> None:
    agent = Ppo(small_ppo(log_std=-0.7), 3, 0)
    mean, action = torch.randn(20, 3), torch.randn(20, 3)
    normal: Any = torch.distributions.Normal(mean, agent.network.log_std.exp())
    found = agent.network.log_probability(mean, action)
    assert torch.allclose(found, normal.log_prob(action).sum(-1), atol=1e-5)
    assert torch.allclose(agent.network.entropy(), normal.entropy()[0].sum(), atol=1e-5)


def test_advantages_are_normalised_per_minibatch() -> None:
    agents = [still(normalise_advantages=on, value_weight=0.0) for on in (True, False)]
    advantage = torch.tensor([3.0, 5.0, 7.0])
    samples = [
        Samples(torch.zeros(3, 6), torch.zeros(3, 1), torch.zeros(3), values, torch.zeros(3))
        for values in (advantage, (advantage - 5.0) / 2.0)
    ]
    found = [agent.objective(batch).item() for agent, batch in zip(agents, samples, strict=True)]
    assert found[0] == pytest.approx(found[1], abs=1e-6)


def test_the_mean_is_squashed_and_samples_spread_about_it() -> None:
    agent = Ppo(small_ppo(log_std=math.log(0.3)), 2, 0)
    for parameter in agent.network.actor.parameters():
        parameter.data.mul_(30.0)
    observation = np.tile(np.random.default_rng(0).normal(size=(1, 6)), (20_000, 1))
    mean, drawn = agent.act(observation), agent.sample(observation)
    assert np.abs(mean).max() <= 1.0
    assert drawn.mean(axis=0) == pytest.approx(mean[0], abs=0.01)
    assert drawn.std(axis=0) == pytest.approx([0.3, 0.3], abs=0.01)


def test_what_is_stored_is_what_was_drawn_so_that_ratios_start_at_one() -> None:
    config = small_run("ppo.log_std=1")
    rollout = RolloutBuffer(20, 8, 2)
    agent, collector = make_agent(config, "cpu"), make_collector(config, rollout)
    assert isinstance(agent, Ppo)
    for _ in range(20):
        collector.step(agent)
    action = rollout.rows[:, :, 6:8]
    assert np.abs(action).max() > 3.0
    samples = agent.samples(rollout)
    with torch.no_grad():
        mean, _ = agent.network(samples.observation)
        found = agent.network.log_probability(mean, samples.action)
    assert torch.equal(found, samples.log_probability)


def falling(fall: str) -> tuple[RolloutBuffer, np.ndarray]:
    """Return the stored transitions of falling bicycles, and their rewards."""
    config = small_run("ppo.log_std=1", f"ppo.fall={fall}", "starts.max_steps=60")
    rollout = RolloutBuffer(60, 8, 2)
    agent, collector = make_agent(config, "cpu"), make_collector(config, rollout)
    for _ in range(60):
        collector.step(agent)
    return rollout, rollout.rows[:, :, 14]


def test_a_fall_is_worth_lying_for_ever_and_a_time_out_bootstraps() -> None:
    rollout, reward = falling("absorbing")
    discount, truncated, fallen = (rollout.rows[:, :, column] for column in (15, 17, 18))
    assert fallen.sum() > 3
    assert (discount[fallen > 0] == 0).all()
    # A fall costs at least 0.27 (30 degrees) / (1 - 0.99).
    assert reward[fallen > 0].max() < -27.0
    assert (discount[fallen == 0] == np.float32(0.99)).all()
    frozen, reward = falling("frozen")
    truncated, fallen = frozen.rows[:, :, 17], frozen.rows[:, :, 18]
    assert (frozen.rows[:, :, 15] == np.float32(0.99)).all()
    assert truncated[-1].sum() == fallen[-1].sum() == 8
    assert reward[-1].tolist() == reward[-2].tolist()


def test_every_transition_is_used_once_an_epoch() -> None:
    agent = Ppo(small_ppo(batch=7), 1, 0)
    batches = agent._minibatches(20)
    for _ in range(3):
        epoch = torch.cat([next(batches) for _ in range(3)])
        assert sorted(epoch.tolist()) == list(range(20))


def test_the_number_of_updates_is_all_epochs_minibatches() -> None:
    config = small_run("ppo.batch=50")
    assert (config.updates_due, config.rounds_between) == (3 * 4, 20)  # 160 rows: 3 x 50 + 10
    off_policy = loading.preset("fast", ["updates=2", "update_every=3"])
    assert (off_policy.updates_due, off_policy.rounds_between) == (2, 3)


@pytest.mark.parametrize("shared", [False, True])
def test_layers_are_shared_only_if_so_wished(shared: bool) -> None:
    agent = Ppo(small_ppo(shared=shared, entropy_weight=0.0), 1, 0)
    samples = agent.samples(rollout_of(20, 8))
    _, value = agent.network(samples.observation)
    value.sum().backward()
    actor: Any = agent.network.actor
    assert (actor.layers[0].weight.grad is not None) == shared
    assert len(list(agent.network.value.parameters())) == (2 if shared else 6)


@pytest.mark.parametrize("shared", [False, True])
def test_it_finds_the_best_action_of_a_one_step_problem(shared: bool) -> None:
    config = small_ppo(
        hidden=(32,), rollout=8, batch=64, gamma=0.0, learning_rate=3e-3, reward_scale=1.0
    )
    agent = Ppo(replace(config, shared=shared), 1, 0)
    rng = np.random.default_rng(0)
    for _ in range(80):
        rollout = RolloutBuffer(8, 32, 1)
        for _ in range(8):
            observation = rng.normal(size=(32, 6))
            action = agent.sample(observation)
            reward = -((action - 0.4) ** 2)
            rest = np.zeros((32, 4))
            rollout.add(np.concatenate([observation, action, observation, reward, rest], axis=1))
        agent.update(rollout, 12)
        assert rollout.rounds == 0
    observation = rng.normal(size=(500, 6))
    assert np.abs(agent.act(observation) - 0.4).mean() < 0.1
    assert agent.network.log_std.exp().item() < 0.5


def test_the_gradient_is_clipped_and_the_learning_rate_falls() -> None:
    agent = Ppo(small_ppo(grad_clip=1e-3, learning_rate=0.1, learning_rate_end=0.5), 1, 0)
    agent.update(rollout_of(20, 8), 1)
    gradients: list[Any] = [parameter.grad for parameter in agent.network.parameters()]
    norm = math.sqrt(sum(float(g.square().sum()) for g in gradients))
    assert norm == pytest.approx(1e-3, rel=1e-3)
    agent.anneal(0.5)
    assert agent.optimiser.param_groups[0]["lr"] == pytest.approx(0.075)


def test_a_rollout_refuses_what_does_not_fit() -> None:
    rollout = rollout_of(3, 2)
    with pytest.raises(ValueError, match="takes 3 times"):
        rollout.add(rollout.rows[0])
    with pytest.raises(ValueError, match="takes 3 times"):
        RolloutBuffer(3, 2, 1).add(np.zeros((1, 18), dtype=np.float32))
    agent = Ppo(small_ppo(), 1, 0)
    with pytest.raises(ValueError, match="not full: 0 of 3"):
        agent.update(RolloutBuffer(3, 2, 1), 1)


@pytest.mark.parametrize("shared", ["false", "true"])
def test_a_resumed_run_gives_the_same_numbers_to_the_bit(shared: str, tmp_path: Path) -> None:
    # Interrupted in the middle of a rollout.
    config = small_run(f"ppo.shared={shared}", "ppo.entropy_weight=0.01")
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    assert online.run(config, whole).updates == 150
    assert online.run(config, parts, stop=after(70)).status == "interrupted"
    assert len(checkpoint.load(parts / "checkpoint" / "state.pt")["replay"]["rows"]) == 11
    assert online.resume(parts, stop=after(31)).status == "interrupted"
    assert online.resume(parts).status == "finished"
    assert_same_run(whole, parts)
    assert {row["kind"] for row in rows(whole)} == {"train", "evaluation"}


def test_a_seed_repeats_a_run_and_another_does_not(tmp_path: Path) -> None:
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        online.run(small_run(f"seed={seed}", "steps=640"), tmp_path / name)
    assert_same_run(tmp_path / "a", tmp_path / "b")
    assert not same(state_of(tmp_path / "a")["agent"], state_of(tmp_path / "c")["agent"])


def test_the_deployed_policy_is_the_mean(tmp_path: Path) -> None:
    config = small_run()
    online.run(config, tmp_path / "run")
    policy = load_policy(tmp_path / "run" / "last.safetensors")
    agent = Ppo(small_ppo(), 2, 99)
    agent.load_state_dict(state_of(tmp_path / "run")["agent"])
    raw = np.random.default_rng(0).normal(size=(50, 6))
    limits = config.scenario.action_limits
    expected = np.column_stack([agent.act(raw) * limits[:2], np.zeros(50)])
    assert np.allclose(policy.act(raw), expected, atol=1e-6)
    assert policy.info.trained["algorithm"] == "ppo"
