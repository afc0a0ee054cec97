"""Small configurations and transitions for the tests of training."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch

from bicycle_controller.config import loading
from bicycle_controller.config.run import DdpgConfig, RunConfig
from bicycle_controller.data.replay_buffer import Batch, ReplayBuffer

SMALL = (
    "ddpg.actor_hidden=[16, 12]",
    "ddpg.critic_hidden=[14, 10]",
    "ddpg.batch=16",
    "ddpg.capacity=3000",
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
"""A run of about a second."""


def small_run(*overrides: str, preset: str = "paper") -> RunConfig:
    """Return a preset, small enough for a test."""
    return loading.preset(preset, [*SMALL, *overrides])


def ddpg_of(config: RunConfig) -> DdpgConfig:
    """Return the DDPG part of a run that has one."""
    assert config.ddpg is not None
    return config.ddpg


def small_ddpg(**changes: Any) -> DdpgConfig:
    """DDPG with small networks and the given switches."""
    return replace(ddpg_of(small_run("ddpg.initialisation=fan_in")), **changes)


def batch_of(
    observation: Any, action: Any, reward: Any, discount: Any, next_observation: Any = None
) -> Batch:
    """Return a batch from plain lists; the flags, which no update reads, are zero."""
    following = observation if next_observation is None else next_observation
    zero = [0.0] * len(reward)
    columns = (observation, action, following, reward, discount, zero, zero, zero)
    return Batch(*(torch.tensor(column, dtype=torch.float32) for column in columns))


def random_replay(
    actions: int,
    rows: int = 2000,
    seed: int = 0,
    observations: int = 6,
    expert_action: bool = False,
) -> ReplayBuffer:
    """Return a memory full of random transitions, one in ten final."""
    rng = np.random.default_rng(seed)
    replay = ReplayBuffer(rows, actions, observations=observations, expert_action=expert_action)
    replay.add(
        np.concatenate(
            [
                rng.normal(size=(rows, observations)),
                rng.uniform(-1.0, 1.0, (rows, actions)),
                rng.normal(size=(rows, observations)),
                -rng.random((rows, 1)),
                np.where(rng.random((rows, 1)) < 0.1, 0.0, 0.99),
                np.zeros((rows, 3)),
                rng.uniform(-1.0, 1.0, (rows, actions * expert_action)),
            ],
            axis=1,
        )
    )
    return replay
