"""Proximal policy optimisation (section 5.2 of the paper; Schulman et al. 2017).

The policy is a normal distribution about mu(s) = tanh(network(s)) with one standard deviation
per action that does not depend on the state. Its mean is scored, kept and deployed (errata row
38), so it is an `Actor`, as with DDPG.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from bicycle_controller.agents.networks import Actor, Value, linear_layers
from bicycle_controller.agents.single_network_agent import SingleNetworkAgent
from bicycle_controller.config.algorithms import PpoConfig
from bicycle_controller.data.replay_buffer import OBSERVATIONS, Batch
from bicycle_controller.data.rollout_buffer import RolloutBuffer, advantages

ADAM_EPSILON = 1e-5
"""Adam's epsilon, as in the common implementations of PPO."""


@dataclass(frozen=True)
class Samples:
    """B actions of a rollout and the data that the update needs."""

    observation: Tensor
    """(B, 6), scaled."""
    action: Tensor
    """(B, actions), as drawn."""
    log_probability: Tensor
    """(B,), under the policy that drew them."""
    advantage: Tensor
    """(B,)."""
    value_target: Tensor
    """(B,)."""


class PpoNetwork(nn.Module):
    """The policy's mean, its standard deviation and the value of a state.

    Attributes:
        actor: the mean mu.
        value: V, of scaled observations, or of the actor's last hidden layer where shared.
        log_std: logarithms of the standard deviations, (actions,).
    """

    def __init__(self, config: PpoConfig, actions: int, generator: torch.Generator) -> None:
        """Initialise the weights: orthogonal, as is common for PPO; `generator` is on the CPU."""
        super().__init__()
        self.shared = config.shared
        self.actor = Actor(OBSERVATIONS, config.hidden, actions)
        inputs, hidden = (config.hidden[-1], ()) if self.shared else (OBSERVATIONS, config.hidden)
        self.value = Value(inputs, hidden)
        self.log_std = nn.Parameter(torch.full((actions,), config.log_std))
        for network, gain in ((self.actor, 0.01), (self.value, 1.0)):
            for layer in linear_layers(network):
                last = layer is network.layers[-1]
                nn.init.orthogonal_(layer.weight, gain if last else math.sqrt(2.0), generator)
                nn.init.zeros_(layer.bias)

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Return mu (B, actions) and V (B,) for scaled observations (B, 6)."""
        features = self.actor.features(observation)
        mean = torch.tanh(self.actor.layers[-1](features))
        return mean, self.value(features if self.shared else observation)

    def log_probability(self, mean: Tensor, action: Tensor) -> Tensor:
        """Return the logarithm (B,) of the density of actions (B, actions) about `mean`."""
        offset = (action - mean) / self.log_std.exp()
        constant = 0.5 * math.log(2.0 * math.pi)
        return -(0.5 * offset.square() + self.log_std + constant).sum(-1)

    def entropy(self) -> Tensor:
        """Return the entropy H, the same in every state."""
        return (self.log_std + 0.5 * math.log(2.0 * math.pi * math.e)).sum()


def clipped_objective(ratio: Tensor, advantage: Tensor, clip: float) -> Tensor:
    """Return J^CLIP of section 5.2, for ratios (B,) and advantages (B,)."""
    bounded = ratio.clamp(1.0 - clip, 1.0 + clip)
    return torch.min(ratio * advantage, bounded * advantage).mean()


class Ppo(SingleNetworkAgent[PpoConfig]):
    """The policy, its value function and their optimiser."""

    def __init__(
        self, config: PpoConfig, actions: int, seed: int, device: torch.device | str = "cpu"
    ) -> None:
        """Initialise the network.

        Args:
            config: every number and switch.
            actions: numbers per action.
            seed: of initialisation, drawn actions and minibatches.
            device: of the network and its updates.
        """
        network = PpoNetwork(config, actions, torch.Generator().manual_seed(seed))
        super().__init__(config, network, seed + 1, device, ADAM_EPSILON)

    @torch.no_grad()
    def sample(self, observation: np.ndarray) -> np.ndarray:
        """Draw actions (N, actions) for raw observations (N, 6); they may exceed 1."""
        mean = self.actor(self.scaled(observation))
        drawn = torch.randn(mean.shape, generator=self.generator, device=self.device)
        action: np.ndarray = (mean + self.network.log_std.exp() * drawn).cpu().numpy()
        return action

    def update(self, rollout: RolloutBuffer, count: int) -> None:
        """Make `count` updates, one minibatch each, and clear the rollout.

        Raises:
            ValueError: if the rollout is not full.
        """
        if not rollout.full:
            raise ValueError(f"the rollout is not full: {rollout.rounds} of {len(rollout.rows)}")
        samples = self.samples(rollout)
        for _, index in zip(range(count), self._minibatches(len(samples.action)), strict=False):
            drawn = Samples(*(column[index] for column in vars(samples).values()))
            self.descend(-self.objective(drawn))
        rollout.clear()

    def _minibatches(self, rows: int) -> Iterator[Tensor]:
        """Yield indices of minibatches without end; each row once before any is repeated."""
        while True:
            order = torch.randperm(rows, generator=self.generator, device=self.device)
            yield from torch.split(order, self.config.batch)

    @torch.no_grad()
    def samples(self, rollout: RolloutBuffer) -> Samples:
        """Return the rollout's T x N actions with the current policy's and value's data."""
        rows = torch.from_numpy(rollout.rows.reshape(-1, rollout.rows.shape[-1])).to(self.device)
        sizes = [OBSERVATIONS, rollout.actions, OBSERVATIONS, 1, 1, 1, 1, 1]
        parts = torch.split(rows, sizes, dim=1)
        batch = Batch(*parts[:3], *(part.squeeze(1) for part in parts[3:]))
        observation = batch.observation / self.scale
        mean, value = self.network(observation)
        _, next_value = self.network(batch.next_observation / self.scale)
        ended = (batch.truncated > 0) | (batch.discount == 0)
        columns = (batch.reward * self.config.reward_scale, value, next_value, batch.discount)
        shape = rollout.rows.shape[:2]
        reward, now, later, discount = (
            column.double().cpu().numpy().reshape(shape) for column in columns
        )
        ends = ended.cpu().numpy().reshape(shape)
        found = advantages(reward, now, later, discount, ends, self.config.gae_lambda)
        advantage = torch.from_numpy(found.reshape(-1)).to(value)
        log_probability = self.network.log_probability(mean, batch.action)
        return Samples(observation, batch.action, log_probability, advantage, advantage + value)

    def objective(self, samples: Samples) -> Tensor:
        """Return J^CLIP' of section 5.2, to be maximised."""
        config, network = self.config, self.network
        advantage = samples.advantage
        if config.normalise_advantages and len(advantage) > 1:
            advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
        mean, value = network(samples.observation)
        log_ratio = network.log_probability(mean, samples.action) - samples.log_probability
        ratio = log_ratio.exp()
        surrogate = clipped_objective(ratio, advantage, config.clip)
        value_error = (value - samples.value_target).square().mean()
        entropy = network.entropy()
        clipped = ((ratio - 1.0).abs() > config.clip).float().mean()
        self.notes.add(
            objective=surrogate,
            value_loss=value_error,
            entropy=entropy,
            divergence=(ratio - 1.0 - log_ratio).mean(),
            clipped=clipped,
        )
        return surrogate - config.value_weight * value_error + config.entropy_weight * entropy
