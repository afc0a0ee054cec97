"""Normalised advantage functions (section 5.2 of the paper; Gu et al. 2016).

Q(s, a) = V(s) - 1/2 (a - mu(s))^T P(s) (a - mu(s)) with P = L L^T, so that mu is its maximum.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from bicycle_controller.agents.notes import Notes
from bicycle_controller.learner_config import NafConfig
from bicycle_controller.networks import OUTPUT_RANGE, Actor, Value, initialise
from bicycle_controller.replay import OBSERVATIONS, Batch, Replay

LOG_EVERY = 12
"""Updates between two that enter the metrics."""


class NafNetwork(nn.Module):
    """V, mu and L on shared hidden layers.

    Attributes:
        actor: the hidden layers and mu, which is the policy.
        value: V, from the last hidden layer.
        entries: the entries of L in rows, from the last hidden layer; linear.
    """

    def __init__(self, config: NafConfig, actions: int, generator: torch.Generator) -> None:
        """Draw the start; `generator` is on the CPU."""
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
        """V (B,), mu (B, A) and L (B, A, A) for scaled observations (B, 6).

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
        """V (B,) alone, of scaled observations (B, 6)."""
        found: Tensor = self.value(self.actor.features(observation))
        return found

    def q(self, observation: Tensor, action: Tensor) -> Tensor:
        """Q (B,) of scaled observations (B, 6) and normalised actions (B, A)."""
        value, mean, lower = self(observation)
        return value + advantage(action - mean, lower)


def advantage(offset: Tensor, lower: Tensor) -> Tensor:
    """A (B,) = -1/2 |L^T (a - mu)|^2 for a - mu (B, A) and L (B, A, A)."""
    stretched = (lower.transpose(-2, -1) @ offset.unsqueeze(-1)).squeeze(-1)
    return -0.5 * stretched.square().sum(-1)


class Naf:
    """The network, its slow copy and its optimiser.

    Attributes:
        network: V, mu and L.
        target: slow copy, of which V makes the targets.
        updates: updates made.
    """

    backend = "autograd"

    def __init__(
        self, config: NafConfig, actions: int, seed: int, device: torch.device | str = "cpu"
    ) -> None:
        """Draw the network.

        Args:
            config: every number and switch.
            actions: numbers per action.
            seed: of the network's start and of the draws from the memory.
            device: where networks and updates live.
        """
        self.config, self.device, self.updates = config, torch.device(device), 0
        start = torch.Generator().manual_seed(seed)
        self.network = NafNetwork(config, actions, start).to(self.device)
        self.target = copy.deepcopy(self.network).requires_grad_(False)
        self.optimiser = torch.optim.Adam(
            self.network.parameters(), config.learning_rate, fused=True
        )
        self.generator = torch.Generator(self.device).manual_seed(seed + 1)
        self.scale = torch.tensor(config.observation_scale, device=self.device)
        self.notes = Notes()

    @property
    def actor(self) -> Actor:
        """mu, for scaled observations."""
        return self.network.actor

    @property
    def deployed(self) -> Actor:
        """The policy to score and keep: mu."""
        return self.network.actor

    @torch.no_grad()
    def act(self, observation: np.ndarray) -> np.ndarray:
        """Normalised actions (N, actions) for raw observations (N, 6), without noise."""
        raw = torch.as_tensor(observation, dtype=torch.float32, device=self.device)
        action: np.ndarray = self.actor(raw / self.scale).cpu().numpy()
        return action

    def anneal(self, progress: float) -> None:
        """Set the learning rate for a run of which the share `progress` is done."""
        share = 1.0 - (1.0 - self.config.learning_rate_end) * min(progress, 1.0)
        for group in self.optimiser.param_groups:
            group["lr"] = share * self.config.learning_rate

    def update(self, replay: Replay, count: int) -> None:
        """Make `count` updates from one draw out of the memory."""
        size = self.config.batch
        for batch in replay.sample(count * size, self.generator).parts(size):
            self.update_on(batch)

    def update_on(self, batch: Batch) -> None:
        """Make one update from `batch`, as it came from the memory."""
        value = self.network.q(batch.observation / self.scale, batch.action)
        loss = functional.mse_loss(value, self.targets(batch))
        self.optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        if self.config.grad_clip > 0:
            nn.utils.clip_grad_norm_(self.network.parameters(), self.config.grad_clip)
        self.optimiser.step()
        with torch.no_grad():
            slow: list[Tensor] = list(self.target.parameters())
            torch._foreach_lerp_(slow, list(self.network.parameters()), self.config.tau)
        if self.updates % LOG_EVERY == 0:
            self.notes.add(loss=loss, q_data=value.mean())
        self.updates += 1

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """y (B,) = r + gamma V'(s'), for a batch as it came from the memory."""
        following = self.target.state_value(batch.next_observation / self.scale)
        return batch.reward * self.config.reward_scale + batch.discount * following

    def metrics(self) -> dict[str, float]:
        """Means of the loss and of Q since the last call."""
        return self.notes.take()

    def state_dict(self) -> dict[str, Any]:
        """Network, target, optimiser, generator and counter."""
        parts = ("network", "target", "optimiser", "notes")
        state = {name: getattr(self, name).state_dict() for name in parts}
        return state | {"generator": self.generator.get_state(), "updates": self.updates}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from `state`, to the bit."""
        for name in ("network", "target", "optimiser", "notes"):
            getattr(self, name).load_state_dict(state[name])
        self.generator.set_state(state["generator"].cpu())
        self.updates = int(state["updates"])
