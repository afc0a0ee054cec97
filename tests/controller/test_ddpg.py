from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from training_maker import batch_of, random_replay, small_ddpg

from bicycle_controller.agents.ddpg import Ddpg
from bicycle_controller.agents.fused import FusedDdpg
from bicycle_controller.agents.native import load
from bicycle_controller.config.run import DdpgConfig
from bicycle_controller.data.replay_buffer import NStepAccumulator, ReplayBuffer, RewardShaping
from bicycle_controller.training import checkpoint

Kind = Callable[[DdpgConfig, int, int], Ddpg]


def fused(config: DdpgConfig, actions: int, seed: int) -> Ddpg:
    """Use the hand-written updates in torch."""
    return FusedDdpg(replace(config, backend="fused"), actions, seed)


def native(config: DdpgConfig, actions: int, seed: int) -> Ddpg:
    """Use the hand-written updates in C++."""
    return FusedDdpg(replace(config, backend="native"), actions, seed)


COMPILED = pytest.mark.skipif(load() is None, reason="no C++ compiler here")
BY_HAND = [fused, pytest.param(native, marks=COMPILED)]
EVERY = pytest.mark.parametrize("kind", [Ddpg, *BY_HAND])
PARTS = ("actor", "critics", "actor_target", "critic_targets", "actor_average")
ZERO, FALSE, TRUE = np.zeros((1, 6)), np.array([False]), np.array([True])


def constant_critics(agent: Ddpg, *values: float) -> None:
    """Make each target critic say one value everywhere."""
    for critic, value in zip(agent.critic_targets, values, strict=True):
        for parameter in critic.parameters():
            parameter.data.zero_()
        list(critic.parameters())[-1].data.fill_(value)


def target_of(
    agent: Ddpg,
    reward: float,
    terminated: np.ndarray = FALSE,
    truncated: np.ndarray = FALSE,
    fallen: np.ndarray = FALSE,
) -> float:
    """Return the critic's target for one step that ends so, the whole way through the memory."""
    config = agent.config
    returns = NStepAccumulator(1, 1, RewardShaping.of(config))
    replay = ReplayBuffer(4, 1)
    step = (ZERO, np.zeros((1, 1)), np.array([reward]), ZERO, terminated, truncated, fallen)
    replay.add(returns.push(*step))
    batch = replay.sample(config.batch, torch.Generator().manual_seed(0))
    return float(agent.targets(agent._prepared(batch))[0])


@EVERY
@pytest.mark.parametrize("fall", ["frozen", "absorbing"])
def test_targets_of_every_end_by_hand(kind: Kind, fall: str) -> None:
    config = small_ddpg(fall=fall, gamma=0.9, reward_scale=0.1, fall_penalty=1.0)
    agent = kind(config, 1, 0)
    constant_critics(agent, -5.0)
    bootstrapped = 0.1 * -2.0 + 0.9 * -5.0
    assert target_of(agent, -2.0) == pytest.approx(bootstrapped)
    assert target_of(agent, -2.0, truncated=TRUE) == pytest.approx(bootstrapped)
    assert target_of(agent, -2.0, terminated=TRUE) == pytest.approx(0.1 * -2.0)
    # A fall pays -2 - 1 now and, frozen, whatever the critic says of the frozen state;
    # absorbing, the same reward for ever: -3 / (1 - 0.9) = -30.
    expected = 0.1 * -30.0 if fall == "absorbing" else 0.1 * -3.0 + 0.9 * -5.0
    assert target_of(agent, -2.0, fallen=TRUE) == pytest.approx(expected)


@EVERY
def test_twin_critics_give_their_minimum(kind: Kind) -> None:
    agent = kind(small_ddpg(critics=2, gamma=0.5), 1, 0)
    constant_critics(agent, -3.0, -7.0)
    assert target_of(agent, -1.0) == pytest.approx(-1.0 + 0.5 * -7.0)


@EVERY
def test_bounded_targets_stay_within_what_can_be_true(kind: Kind) -> None:
    config = small_ddpg(bound_values=True, gamma=0.5, reward_min=-10.0, reward_scale=0.1)
    agent = kind(config, 1, 0)
    constant_critics(agent, 8.0)
    assert target_of(agent, -1.0) == 0.0
    constant_critics(agent, -99.0)
    assert target_of(agent, -1.0) == pytest.approx(-10.0 * 0.1 / 0.5)


@EVERY
def test_smoothing_noise_is_clipped_and_moves_the_targets_action(kind: Kind) -> None:
    config = small_ddpg(smoothing=10.0, smoothing_clip=0.25, action_layer=2)
    agent = kind(config, 1, 0)
    action = torch.zeros(1000, 1)
    smoothed = agent._smoothed(action)
    assert set(smoothed.abs().flatten().tolist()) > {0.25}
    assert smoothed.abs().max() == 0.25
    assert agent._smoothed(torch.ones(1000, 1)).max() == 1.0


def hand_worked_agent(kind: Kind) -> Ddpg:
    config = small_ddpg(
        actor_hidden=(1,),
        critic_hidden=(1,),
        action_layer=1,
        batch=1,
        actor_learning_rate=0.01,
        critic_learning_rate=0.1,
        tau=0.25,
        observation_scale=(2.0, 1.0, 1.0, 1.0, 1.0, 1.0),
    )
    agent = kind(config, 1, 0)
    for network in (agent.actor, agent.actor_target):
        set_parameters(network, [[1.0, 0, 0, 0, 0, 0]], [0.0], [[0.0]], [0.0])
    for critic in (agent.critics[0], agent.critic_targets[0]):
        set_parameters(critic, [[1.0, 0, 0, 0, 0, 0, 2.0]], [0.0], [[3.0]], [1.0])
    return agent


def set_parameters(network: torch.nn.Module, *values: list[Any]) -> None:
    for parameter, value in zip(network.parameters(), values, strict=True):
        parameter.data.copy_(torch.tensor(value))


@EVERY
def test_one_update_by_hand(kind: Kind) -> None:
    agent = hand_worked_agent(kind)
    agent.update_on(batch_of([[2.0, 0, 0, 0, 0, 0]], [[0.5]], [-1.0], [0.0]))
    # The observation is 2 / 2 = 1. Q = 3 (1 + 2 * 0.5) + 1 = 7 and y = -1, so the loss's slope
    # is 16, positive at every parameter that is used; Adam's first step is the learning rate.
    critic = [p.detach().flatten().tolist() for p in agent.critics[0].parameters()]
    expected: list[list[float]] = [[0.9, 0, 0, 0, 0, 0, 1.9], [-0.1], [2.9], [0.9]]
    for found, value in zip(critic, expected, strict=True):
        assert found == pytest.approx(value, abs=1e-6)
    # The actor's slope is -2.9 * 1.9 at its output, times the hidden 1 at the weight, so both
    # grow by the learning rate; the output weight was 0, so nothing reaches the hidden layer.
    actor = [p.detach().flatten().tolist() for p in agent.actor.parameters()]
    expected = [[1, 0, 0, 0, 0, 0], [0], [0.01], [0.01]]
    for found, value in zip(actor, expected, strict=True):
        assert found == pytest.approx(value, abs=1e-6)
    slow = [p.flatten().tolist() for p in agent.actor_target.parameters()]
    assert slow[3] == pytest.approx([0.0025], abs=1e-7)
    slow = [p.flatten().tolist() for p in agent.critic_targets[0].parameters()]
    assert slow[2] == pytest.approx([3.0 - 0.25 * 0.1], abs=1e-6)


def gradient(parameter: torch.Tensor) -> list[float]:
    assert parameter.grad is not None
    return list(parameter.grad.flatten().tolist())


def test_the_gradients_of_that_update_by_hand() -> None:
    agent = hand_worked_agent(Ddpg)
    agent.update_on(batch_of([[2.0, 0, 0, 0, 0, 0]], [[0.5]], [-1.0], [0.0]))
    critic = [gradient(p) for p in agent.critics[0].parameters()]
    assert critic == [[48, 0, 0, 0, 0, 0, 24], [48], [32], [16]]
    actor = [gradient(p) for p in agent.actor.parameters()]
    assert actor[2] == pytest.approx([-2.9 * 1.9])
    assert actor[3] == pytest.approx([-2.9 * 1.9])


@EVERY
def test_the_actor_and_the_targets_wait_for_their_turn(kind: Kind) -> None:
    agent, replay = kind(small_ddpg(actor_every=3), 2, 0), random_replay(2)
    start = [p.detach().clone() for p in (*agent.actor.parameters(),)]
    slow = [p.detach().clone() for p in agent.critic_targets.parameters()]
    agent.update(replay, 2)
    assert all(torch.equal(a, b) for a, b in zip(start, agent.actor.parameters(), strict=True))
    assert all(
        torch.equal(a, b) for a, b in zip(slow, agent.critic_targets.parameters(), strict=True)
    )
    agent.update(replay, 1)
    assert not all(torch.equal(a, b) for a, b in zip(start, agent.actor.parameters(), strict=True))


@EVERY
def test_the_learning_rates_fall_in_a_straight_line(kind: Kind) -> None:
    """Adam's first step is the learning rate, so the critic's output bias tells it."""
    for progress, share in ((0.0, 1.0), (0.5, 0.6), (1.0, 0.2), (1.5, 0.2)):
        agent = kind(small_ddpg(learning_rate_end=0.2, critic_learning_rate=0.01), 2, 0)
        bias = list(agent.critics.parameters())[-1]
        before = bias.item()
        agent.anneal(progress)
        agent.update(random_replay(2), 1)
        assert abs(bias.item() - before) == pytest.approx(0.01 * share, rel=1e-3)


@EVERY
def test_the_averaged_actor_follows_and_is_the_one_deployed(kind: Kind) -> None:
    agent, replay = kind(small_ddpg(actor_average=0.25), 2, 0), random_replay(2)
    expected = [p.detach().clone() for p in agent.actor.parameters()]
    for _ in range(3):
        agent.update(replay, 1)
        pairs = zip(expected, agent.actor.parameters(), strict=True)
        expected = [0.75 * slow + 0.25 * main.detach() for slow, main in pairs]
    found = list(agent.deployed.parameters())
    assert all(torch.allclose(a, b, atol=1e-7) for a, b in zip(expected, found, strict=True))
    assert kind(small_ddpg(), 2, 0).deployed is not agent.deployed
    plain = kind(small_ddpg(), 2, 0)
    assert plain.deployed is plain.actor


SWITCHES: dict[str, dict[str, Any]] = {
    "paper": {},
    "td3": {"critics": 2, "actor_every": 2, "smoothing": 0.2},
    "norms": {"critic_layer_norm": True, "actor_layer_norm": True},
    "huber and clip": {"huber": 0.1, "grad_clip": 0.05},
    "bc": {"bc_weight": 1.0, "saturation_penalty": 0.1},
    "average": {"actor_average": 0.01, "n_step": 3},
    "mirror": {"mirror": True, "bound_values": True, "reward_scale": 0.1},
    "first layer": {"action_layer": 1, "critics": 2, "critic_layer_norm": True},
    "symmetric": {"symmetric_actor": True, "mirror": True, "actor_average": 0.1, "bc_weight": 0.5},
    "bc to a teacher": {"bc_weight": 1.0, "bc_to": "teacher", "mirror": True},
    "critic sees more": {"critic_sees": ("speed", "goal_distance"), "mirror": True},
    "first layer sees more": {"critic_sees": ("speed",), "action_layer": 1, "critics": 2},
    "three layers": {"critic_hidden": (9, 8, 7), "actor_hidden": (5,), "action_layer": 3},
}


@pytest.mark.parametrize("kind", BY_HAND)
@pytest.mark.parametrize("name", SWITCHES)
def test_hand_written_gradients_equal_autograd(kind: Kind, name: str) -> None:
    config = small_ddpg(**SWITCHES[name])
    taught = config.bc_to == "teacher"
    replay = random_replay(2, observations=len(config.critic_scale), expert_action=taught)
    first, second = Ddpg(config, 2, 3), kind(config, 2, 3)
    start = [p.detach().clone() for p in first.actor.parameters()]
    for agent in (first, second):
        for _ in range(10):
            agent.update(replay, 3)
    for part in PARTS:
        pairs = zip(
            getattr(first, part).parameters(), getattr(second, part).parameters(), strict=True
        )
        for one, other in pairs:
            # An output bias that cancels out in a symmetric actor has a slope of rounding only,
            # which Adam magnifies; what such an actor answers is compared below.
            if not (config.symmetric_actor and one.shape in {(2,), (12,)}):
                assert torch.allclose(one, other, rtol=0, atol=1e-5)
    seen = np.random.default_rng(1).normal(size=(100, 6))
    assert np.abs(first.act(seen) - second.act(seen)).max() < 1e-4
    moved = [(a - b).abs().max() for a, b in zip(start, first.actor.parameters(), strict=True)]
    assert min(moved) > 1e-3
    metrics = first.metrics(), second.metrics()
    assert metrics[0] == pytest.approx(metrics[1], rel=1e-3, abs=1e-5)
    assert set(metrics[0]) == {"critic_loss", "q_data", "q_policy"}


@EVERY
def test_a_symmetric_actor_answers_the_mirrored_bicycle_mirrored(kind: Kind) -> None:
    agent = kind(small_ddpg(symmetric_actor=True), 3, 0)
    agent.update(random_replay(3), 50)
    seen = np.random.default_rng(1).normal(size=(40, 6))
    left, right = agent.act(seen), agent.act(-seen)
    assert np.abs(left + right * [1.0, 1.0, -1.0]).max() < 1e-6
    assert np.ptp(left, axis=0).min() > 0.01
    assert agent.act(np.zeros((1, 6)))[0, :2] == pytest.approx([0.0, 0.0])


def test_imitation_pulls_towards_what_the_teacher_shows() -> None:
    config = small_ddpg(bc_weight=1.0, bc_alpha=1e-9, bc_to="teacher", reward_scale=1e-3)
    agent, replay = Ddpg(config, 2, 0), random_replay(2, rows=16, expert_action=True)
    before = distance(agent, replay)
    agent.update(replay, 400)
    assert distance(agent, replay) < 0.5 * before


def distance(agent: Ddpg, replay: ReplayBuffer) -> float:
    """Return the mean squared distance of the actor's actions from the teacher's."""
    rows = replay.table.numpy()
    return float(np.square(agent.act(rows[:, :6]) - rows[:, -2:]).mean())


def test_only_the_critic_sees_what_the_actor_does_not() -> None:
    config = small_ddpg(critic_sees=("speed",))
    agent = Ddpg(config, 2, 0)
    batch = random_replay(2, observations=7).sample(64, torch.Generator())
    faster = torch.cat([batch.observation[:, :6], batch.observation[:, 6:] + 1.0], dim=1)
    values = [agent.critics[0](seen, batch.action) for seen in (batch.observation, faster)]
    assert (values[0] - values[1]).abs().max() > 1e-4
    assert agent.act(batch.observation[:, :6].numpy()).shape == (64, 2)


@pytest.mark.parametrize("kind", BY_HAND)
def test_hand_written_gradients_equal_autograd_at_the_papers_sizes(kind: Kind) -> None:
    config = replace(small_ddpg(), actor_hidden=(400, 300), critic_hidden=(200, 200), batch=64)
    replay = random_replay(3)
    first, second = Ddpg(config, 3, 0), kind(config, 3, 0)
    for agent in (first, second):
        agent.update(replay, 5)
    for part in ("actor", "critics"):
        pairs = zip(
            getattr(first, part).parameters(), getattr(second, part).parameters(), strict=True
        )
        assert all(torch.allclose(one, other, rtol=0, atol=1e-5) for one, other in pairs)


@EVERY
@pytest.mark.parametrize("other", [Ddpg, *BY_HAND])
def test_any_backend_goes_on_where_another_stopped(
    kind: Kind, other: Kind, tmp_path: Path
) -> None:
    """Layers with few inputs lie turned in the memory of one of them."""
    config, replay = small_ddpg(critics=2, critic_layer_norm=True), random_replay(2)
    first, second = kind(config, 2, 0), other(config, 2, 77)
    first.update(replay, 20)
    checkpoint.save(tmp_path / "state.pt", first.state_dict())
    second.load_state_dict(checkpoint.load(tmp_path / "state.pt"))
    for agent in (first, second):
        agent.update(replay, 10)
    for part in PARTS:
        pairs = zip(
            getattr(first, part).parameters(), getattr(second, part).parameters(), strict=True
        )
        assert all(torch.allclose(mine, theirs, rtol=0, atol=1e-5) for mine, theirs in pairs)


@EVERY
@pytest.mark.parametrize("switches", [{}, {"critics": 2, "smoothing": 0.1, "mirror": True}])
def test_a_saved_agent_goes_on_to_the_bit(
    kind: Kind, switches: dict[str, Any], tmp_path: Path
) -> None:
    config, replay = small_ddpg(**switches), random_replay(2)
    agent, other = kind(config, 2, 0), kind(config, 2, 77)
    agent.update(replay, 5)
    checkpoint.save(tmp_path / "state.pt", agent.state_dict())
    other.load_state_dict(checkpoint.load(tmp_path / "state.pt"))
    for learner in (agent, other):
        learner.update(replay, 5)
    mine, theirs = agent.state_dict(), other.state_dict()
    for part in PARTS:
        assert all(torch.equal(mine[part][key], theirs[part][key]) for key in mine[part])
    assert agent.metrics() == other.metrics()


@pytest.mark.parametrize("switches", [{}, {"critics": 2, "actor_every": 2, "smoothing": 0.05}])
def test_it_finds_the_best_action_of_a_one_step_problem(switches: dict[str, Any]) -> None:
    rng = np.random.default_rng(0)
    action = rng.uniform(-1, 1, (2000, 1))
    reward = -((action - 0.4) ** 2)
    rest = np.zeros((2000, 4))
    observation = rng.normal(size=(2000, 6))
    replay = ReplayBuffer(2000, 1)
    replay.add(np.concatenate([observation, action, observation, reward, rest], axis=1))
    sizes = {"critic_hidden": (32, 32), "batch": 64, "critic_learning_rate": 5e-3}
    agent = FusedDdpg(small_ddpg(**sizes, **switches), 1, 0)
    before = np.abs(agent.act(observation) - 0.4).max()
    agent.update(replay, 1500)
    assert before > 0.3
    assert np.abs(agent.act(observation) - 0.4).mean() < 0.1


def test_the_mirror_turns_lean_steering_and_goal_but_not_the_pedal() -> None:
    agent = Ddpg(small_ddpg(mirror=True, batch=400), 3, 0)
    batch = batch_of([[1.0] * 6] * 400, [[0.1, 0.2, 0.3]] * 400, [-1.0] * 400, [0.9] * 400)
    prepared = agent._prepared(batch)
    signs = prepared.observation[:, 0].sign()
    assert 150 < (signs > 0).sum() < 250
    assert torch.equal(prepared.observation.sign(), signs[:, None].expand(-1, 6))
    assert torch.equal(prepared.next_observation, prepared.observation)
    expected = torch.stack([0.1 * signs, 0.2 * signs, torch.full((400,), 0.3)], dim=1)
    assert torch.allclose(prepared.action, expected)
    assert torch.equal(prepared.reward, batch.reward)
