"""Creation of a run's agent, memory and collector from its configuration."""

from __future__ import annotations

from bicycle_controller.agents.base import Agent, Memory
from bicycle_controller.agents.ddpg import Ddpg
from bicycle_controller.agents.fused import FusedDdpg
from bicycle_controller.agents.naf import Naf
from bicycle_controller.agents.ppo import Ppo
from bicycle_controller.config.algorithms import DdpgConfig, NafConfig, PpoConfig
from bicycle_controller.config.run import RunConfig
from bicycle_controller.data.replay_buffer import ReplayBuffer
from bicycle_controller.data.rollout_buffer import RolloutBuffer
from bicycle_controller.training.collector import Collector, observations, teaches
from bicycle_controller.training.rollout_collector import RolloutCollector


def make_agent(config: RunConfig, device: str) -> Agent:
    """Create the learner; the fused DDPG supports every switch, so `auto` selects it."""
    learner, actions = config.learner, _actions(config)
    if isinstance(learner, NafConfig):
        return Naf(learner, actions, config.seed, device)
    if isinstance(learner, PpoConfig):
        return Ppo(learner, actions, config.seed, device)
    kind = Ddpg if learner.backend == "autograd" else FusedDdpg
    return kind(learner, actions, config.seed, device)


def make_memory(config: RunConfig, device: str) -> Memory:
    """Create a replay memory, or for PPO the rollout between two rounds of updates."""
    learner, actions = config.learner, _actions(config)
    if isinstance(learner, (DdpgConfig, NafConfig)):
        return ReplayBuffer(
            learner.capacity, actions, device, observations(learner), teaches(learner)
        )
    return RolloutBuffer(learner.rollout, config.bicycles, actions)


def make_collector(config: RunConfig, memory: Memory, device: str = "cpu") -> Collector:
    """Create the bicycles, which explore by noise or by PPO's own distribution."""
    kind = Collector if config.ppo is None else RolloutCollector
    return kind(config, memory, device)


def _actions(config: RunConfig) -> int:
    return int((config.scenario.action_limits > 0).sum())
