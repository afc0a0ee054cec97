"""Gymnasium's Pendulum-v1 as a task for this project's collector: the agents on known ground.

The three observations are followed by three zeros, which no weight can make anything of, and
the torque limit of 2 N m happens to be the bicycle's, so that nothing else needs changing.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import torch

from bicycle_controller.agents.base import Agent
from bicycle_controller.agents.networks import Actor
from bicycle_controller.config import loading
from bicycle_controller.config.run import RunConfig
from bicycle_controller.training.factory import make_agent, make_collector, make_memory
from bicycle_sim.task.task import Step

OVERRIDES = (
    "scenario.torque_limit=2",
    "scenario.displacement_limit=0",
    "starts.max_steps=200",
)
"""Scenario whose only action is as large as the pendulum's; episodes end after 200 steps only."""


class PendulumTask:
    """N pendulums with the part of `BicycleTask` that collecting uses."""

    def __init__(self, count: int, seed: int) -> None:
        """Start `count` pendulums."""
        self.rng = np.random.default_rng(seed)
        self.envs = [gymnasium.make("Pendulum-v1") for _ in range(count)]
        self._observation = np.zeros((count, 6))
        for index, env in enumerate(self.envs):
            first, _ = env.reset(seed=seed + index)
            self._observation[index, :3] = first

    def reset(self, mask: np.ndarray) -> np.ndarray:
        """Start the pendulums of `mask` (N,) again."""
        for index in np.flatnonzero(mask):
            self._observation[index, :3], _ = self.envs[index].reset()
        return self.observation()

    def observation(self) -> np.ndarray:
        """cos, sin, rad/s and three zeros of every pendulum, (N, 6)."""
        return self._observation.copy()

    def step(self, action: np.ndarray) -> Step:
        """Apply torques (N, 3), N m, of which the first column counts."""
        count = len(self.envs)
        reward, truncated = np.zeros(count), np.zeros(count, dtype=bool)
        for index, env in enumerate(self.envs):
            found = env.step(np.clip(action[index, :1], -2.0, 2.0).astype(np.float32))
            self._observation[index, :3], reward[index], _, truncated[index], _ = found
        no = np.zeros(count, dtype=bool)
        return Step(self.observation(), reward, no, truncated, no, {}, np.zeros(count))


def pendulum_run(preset: str, *overrides: str) -> RunConfig:
    """Return a preset's run, for the pendulum."""
    return loading.preset(preset, [*OVERRIDES, *overrides])


def train(config: RunConfig) -> Agent:
    """Return the training loop, without evaluation and files."""
    memory = make_memory(config, "cpu")
    collector = make_collector(config, memory)
    task: Any = PendulumTask(config.bicycles, config.seed)
    collector.task, collector.observation = task, task.observation()
    agent = make_agent(config, "cpu")
    while collector.steps < config.steps:
        collector.step(agent)
        warm = collector.steps >= config.warm_up
        if warm and collector.rounds % config.rounds_between == 0:
            agent.update(memory, config.updates_due)
    return agent


def returns(actor: Actor, scale: tuple[float, ...], episodes: int, seed: int) -> np.ndarray:
    """Return the return of each of so many episodes without noise, (episodes,)."""
    task = PendulumTask(episodes, seed)
    total = np.zeros(episodes)
    for _ in range(200):
        scaled = torch.as_tensor(task.observation() / np.array(scale), dtype=torch.float32)
        with torch.no_grad():
            torque = 2.0 * actor(scaled).numpy()
        total += task.step(torque).reward
    return total
