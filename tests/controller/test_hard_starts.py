"""Training on harder rides: speeds, kicks, late actions, two physics at once."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from bicycle_controller.config import loading
from bicycle_controller.data.replay_buffer import ReplayBuffer
from bicycle_controller.evaluation.evaluate import evaluate
from bicycle_controller.evaluation.rollouts import Disturbance
from bicycle_controller.evaluation.score import hardships, near, score
from bicycle_controller.policy.policy import load_policy
from bicycle_controller.policy.trained_for import unlike_training
from bicycle_controller.training import checkpoint, online
from bicycle_controller.training.factory import make_agent, make_collector, make_memory
from bicycle_controller.training.run_folder import RunFolder
from bicycle_sim.plants import registry
from bicycle_sim.task.scenario import TEN_KM_H, named

SMALL = [
    "bicycles=32",
    "warm_up=100000",
    "steps=640",
    "ddpg.actor_hidden=[8]",
    "ddpg.critic_hidden=[8]",
]


class Idle:
    """An agent that does nothing and keeps what it was shown."""

    shown: np.ndarray

    def act(self, observation: np.ndarray) -> np.ndarray:
        self.shown = observation
        return np.zeros((len(observation), 2))


def rates(*changes: str) -> tuple[np.ndarray, np.ndarray]:
    """Lean rates and speeds of 32 bicycles on their first 40 steps, without exploration."""
    config = loading.preset(
        "sure",
        [
            *SMALL,
            "warm_up=0",
            "noise.sigma=0",
            "noise.sigma_max=0",
            "starts.one_hardship=false",
            *changes,
        ],
    )
    collector = make_collector(config, make_memory(config, "cpu"), "cpu")
    found = []
    for _ in range(40):
        collector.step(Idle())
        found.append(collector.task.state.lean_rate.copy())
    return np.array(found), collector.task.state.speed


def test_speeds_are_drawn() -> None:
    speed = rates()[1]
    assert speed.min() < 2.0 < 4.0 < speed.max()
    assert np.ptp(rates("starts.speeds=null")[1]) < 1e-9


def test_kicks_come_at_their_rate() -> None:
    changes = ("starts.tilt=0", "starts.tilt_rate=0", "starts.steer=0", "starts.steer_rate=0")
    jumps = np.abs(np.diff(rates(*changes, "starts.kick_every=0.5")[0], axis=0)) > 0.15
    assert 20 < jumps.sum() < 200
    calm = np.abs(np.diff(rates(*changes, "starts.kick=0.0")[0], axis=0))
    assert calm.max() < 0.15


def test_an_episode_has_one_hardship_or_none() -> None:
    config = loading.preset("sure", [*SMALL, "bicycles=2000"])
    collector = make_collector(config, make_memory(config, "cpu"), "cpu")
    states = collector.state_dict()
    fast = ~np.isclose(collector.task.state.speed, TEN_KM_H, atol=1e-3)
    kind, noise = states["hardships"]["kind"], states["hardships"]["noise"]
    masks = [fast, states["late"]["delays"] > 0, noise > 0, kind == 2]
    for some in masks:
        assert 0.12 < some.mean() < 0.25
    assert np.sum(masks, axis=0).max() == 1
    assert 0.0 < noise.max() <= config.starts.noise


def test_the_actor_sees_its_speed_and_its_last_commands() -> None:
    changes = ["warm_up=0", "noise.sigma=0", "noise.sigma_max=0", "starts.noise=0"]
    config = loading.preset("sure", [*SMALL, *changes])
    collector = make_collector(config, make_memory(config, "cpu"), "cpu")
    assert config.ddpg is not None
    names = config.ddpg.inputs

    class Steers(Idle):
        def act(self, observation: np.ndarray) -> np.ndarray:
            super().act(observation)
            return np.full((len(observation), 2), 0.25 * (1 + collector.rounds))

    agent = Steers()
    begun = collector.task.state.speed.copy()
    collector.step(agent)
    assert agent.shown[:, names.index("speed")] == pytest.approx(begun)
    assert not agent.shown[:, names.index("torque[-1]")].any()
    collector.step(agent)
    going = collector.task.steps == 2
    assert going.any()
    assert agent.shown[going, names.index("torque[-1]")] == pytest.approx(0.25)
    collector.step(agent)
    going = collector.task.steps == 3
    last = [agent.shown[going, names.index(f"displacement[-{age}]")] for age in (1, 2, 3)]
    assert [values[0] for values in last] == pytest.approx([0.5, 0.25, 0.0])


def test_the_memory_holds_the_state_that_follows_with_the_command_between() -> None:
    changes = ["starts.noise=0", "ddpg.n_step=1", "warm_up=100000"]
    config = loading.preset("sure", [*SMALL, *changes])
    memory = make_memory(config, "cpu")
    assert isinstance(memory, ReplayBuffer)
    collector = make_collector(config, memory, "cpu")
    collector.step(Idle())
    assert config.ddpg is not None
    names = config.ddpg.inputs
    batch = memory.sample(64, torch.Generator())
    for index, name in enumerate(("torque[-1]", "displacement[-1]")):
        assert torch.equal(batch.next_observation[:, names.index(name)], batch.action[:, index])
    before = batch.observation[:, names.index("lean_rate")]
    assert torch.equal(batch.next_observation[:, names.index("lean_rate[-1]")], before)
    width = len(names) + len(config.ddpg.critic_sees)
    assert batch.observation.shape[1] == width == len(config.ddpg.critic_scale)


def test_the_policy_rides_as_the_agent_answered(tmp_path: Path) -> None:
    config = loading.preset(
        "sure",
        [*SMALL, "warm_up=64", "evaluation.every=1000", "ddpg.actor_average=0", "ddpg.n_step=1"],
    )
    online.run(config, tmp_path)
    policy = load_policy(tmp_path / "last.safetensors")
    assert policy.memory == 6
    assert policy.info.speeds == (1.0, 5.0)
    agent = make_agent(config, "cpu")
    agent.load_state_dict(checkpoint.load(RunFolder(tmp_path).checkpoint)["agent"])
    shown = np.random.default_rng(3).normal(size=(20, len(policy.inputs.names)))
    assert config.ddpg is not None
    units = np.array(policy.info.observation_scale) / config.ddpg.actor_scale
    answered = agent.act(shown.astype(np.float32)) * config.scenario.action_limits[:2]
    assert policy.answer(shown * units)[:, :2] == pytest.approx(answered, abs=1e-4)


def test_the_score_counts_every_hardship() -> None:
    config = loading.preset("sure")
    hard = hardships(config.physics, config.physics_too, config.starts)
    assert len(hard) == 6
    names = ("action_delay", "roll_kick", "observation_noise")
    assert [getattr(trial, name) for (_, trial), name in zip(hard[1:], names, strict=False)] == [
        config.starts.delay,
        config.starts.kick,
        (config.starts.noise,) * 6,
    ]
    assert [trial.speed for _, trial in hard[-2:]] == list(config.starts.speeds or ())
    fixed = dataclasses.replace(config.evaluation, episodes=4, near_episodes=0, hard_episodes=20)
    found = score(load_policy("fixed-speed"), config.scenario, config.physics, fixed, hard)
    assert found.hard_miss_rates is not None
    *_, slow, _ = found.hard_miss_rates
    assert slow > 0.5
    easy = dataclasses.replace(found, hard_miss_rates=None)
    assert found.rank[0] == pytest.approx(easy.rank[0] - sum(found.hard_miss_rates))


def test_the_preset_rides_both_physics() -> None:
    config = loading.preset("sure")
    assert config.physics_too == registry.named(physics="corrected")


def test_a_run_goes_on_to_the_bit(tmp_path: Path) -> None:
    config = loading.preset(
        "sure", [*SMALL, "warm_up=320", "evaluation.every=1000", "tensorboard=false"]
    )
    whole = online.run(config, tmp_path / "whole")
    calls = iter(range(1000))
    online.run(config, tmp_path / "parts", stop=lambda: next(calls) > 14)
    online.resume(tmp_path / "parts")
    assert whole.status == "finished"
    files = [(tmp_path / name / "last.safetensors").read_bytes() for name in ("whole", "parts")]
    sizes = [int.from_bytes(data[:8], "little") for data in files]
    assert files[0][8 + sizes[0] :] == files[1][8 + sizes[1] :]


def test_bad_values_are_told() -> None:
    with pytest.raises(ValueError, match=r"starts\.speeds"):
        loading.preset("fast", ["starts.speeds=[3, 1]"])
    with pytest.raises(ValueError, match=r"starts\.delay"):
        loading.preset("fast", ["starts.delay=-1"])


@pytest.mark.parametrize(
    "trial",
    [
        {"physics": "corrected"},
        {"action_delay": 4},
        {"observation_noise": (0.1,) * 6},
        {"speed": 1.0},
        {"speed": 4.0},
    ],
    ids=str,
)
def test_the_shipped_actor_rides_where_that_of_one_bicycle_falls(trial: dict[str, Any]) -> None:
    policy = load_policy("sure-fixed-speed")
    options = dict(trial)
    plant = registry.named(physics=options.pop("physics", "faithful"))
    goals = near(named("random-start-random-goal"), 10.6)
    found = evaluate(policy, goals, plant, 100, 5, Disturbance(**options))
    assert found.summary()["reach_rate"] >= 0.98
    assert unlike_training(policy, plant, dataclasses.replace(goals, start_speed=5.0)) == []
