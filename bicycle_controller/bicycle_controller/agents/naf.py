"""Normalised advantage functions (section 5.2 of the paper; Gu et al. 2016).

Q(s, a) = V(s) - 1/2 (a - mu(s))^T P(s) (a - mu(s)) with P = L L^T, so that mu is its maximum.
"""

from __future__ import annotations

import copy

import torch
from torch import Tensor, nn
from torch.nn import functional

from bicycle_controller.agents.networks import OUTPUT_RANGE, Actor, Value, initialise
from bicycle_controller.agents.single_network_agent import SingleNetworkAgent
from bicycle_controller.config.algorithms import NafConfig
from bicycle_controller.data.replay_buffer import OBSERVATIONS, Batch, ReplayBuffer

LOG_EVERY = 12
"""Updates between two that are logged."""


class NafNetwork(nn.Module):
    """V, mu and L on shared hidden layers.

    Attributes:
        actor: the hidden layers and mu, which is the policy.
        value: V, from the last hidden layer.
        entries: the entries of L in rows, from the last hidden layer; linear.
    """

    def __init__(self, config: NafConfig, actions: int, generator: torch.Generator) -> None:
        """Initialise the weights; `generator` is on the CPU."""
        super().__init__()
        self.actor = Actor(OBSERVATIONS, config.hidden, actions)
        initialise(self.actor, config.initialisation, generator)
        self.value = Value(config.hidden[-1], ())
        self.entries = nn.Linear(config.hidden[-1], actions * (actions + 1) // 2)
        for parameter in (*self.value.parameters(), *self.entries.parameters()):
            drawn = torch.rand(parameter.shape, generator=generator)
            parameter.data.copy_((2.0 * drawn - 1.0) * OUTPUT_RANGE)
        self._below = torch.tril_indices(actions, actions).tolist()

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return V (B,), mu (B, A) and L (B, A, A) for scaled observations (B, 6).

        L is lower-triangular; its diagonal is the exponential of the layer's output, so that
        P = L L^T is positive definite.
        """
        features = self.actor.features(observation)
        mean = torch.tanh(self.actor.layers[-1](features))
        entries = self.entries(features)
        lower = entries.new_zeros(*mean.shape, mean.shape[-1])
        lower[..., self._below[0], self._below[1]] = entries
        diagonal = torch.diagonal(lower, dim1=-2, dim2=-1)
        lower = torch.tril(lower, -1) + torch.diag_embed(diagonal.exp())
        return self.value(features), mean, lower

    def state_value(self, observation: Tensor) -> Tensor:
        """Return V (B,) only, for scaled observations (B, 6)."""
        found: Tensor = self.value(self.actor.features(observation))
        return found

    def q(self, observation: Tensor, action: Tensor) -> Tensor:
        """Return Q (B,) for scaled observations (B, 6) and normalised actions (B, A)."""
        value, mean, lower = self(observation)
        return value + advantage(action - mean, lower)


def advantage(offset: Tensor, lower: Tensor) -> Tensor:
    """Return A (B,) = -1/2 |L^T (a - mu)|^2 for a - mu (B, A) and L (B, A, A)."""
    stretched = (lower.transpose(-2, -1) @ offset.unsqueeze(-1)).squeeze(-1)
    return -0.5 * stretched.square().sum(-1)


class Naf(SingleNetworkAgent[NafConfig]):
    """V, mu and L, and their slow copy.

    Attributes:
        target: slow copy, whose V gives the targets.
    """

    parts = ("network", "target", "optimiser", "notes")

    def __init__(
        self, config: NafConfig, actions: int, seed: int, device: torch.device | str = "cpu"
    ) -> None:
        """Initialise the network.

        Args:
            config: every number and switch.
            actions: numbers per action.
            seed: of initialisation and draws from the memory.
            device: of networks and updates.
        """
        network = NafNetwork(config, actions, torch.Generator().manual_seed(seed))
        super().__init__(config, network, seed + 1, device)
        self.target = copy.deepcopy(self.network).requires_grad_(False)

    def update(self, replay: ReplayBuffer, count: int) -> None:
        """Make `count` updates from one draw of the memory."""
        size = self.config.batch
        for batch in replay.sample(count * size, self.generator).parts(size):
            self.update_on(batch)

    def update_on(self, batch: Batch) -> None:
        """Make one update from `batch`, as drawn from the memory."""
        value = self.network.q(batch.observation / self.scale, batch.action)
        loss = functional.mse_loss(value, self.targets(batch))
        if self.updates % LOG_EVERY == 0:
            self.notes.add(loss=loss, q_data=value.mean())
        self.descend(loss)
        with torch.no_grad():
            slow: list[Tensor] = list(self.target.parameters())
            torch._foreach_lerp_(slow, list(self.network.parameters()), self.config.tau)

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Return y (B,) = r + gamma V'(s'), for a batch as drawn from the memory."""
        following = self.target.state_value(batch.next_observation / self.scale)
        target: Tensor = batch.reward * self.config.reward_scale + batch.discount * following
        return target
