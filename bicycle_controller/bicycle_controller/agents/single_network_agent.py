"""Common base of NAF and PPO: one network that contains an actor, one optimiser, one generator."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np
import torch
from torch import Tensor, nn

from bicycle_controller.agents.answer import Answer
from bicycle_controller.agents.networks import Actor
from bicycle_controller.agents.running_means import RunningMeans
from bicycle_controller.config.algorithms import NafConfig, PpoConfig

Config = TypeVar("Config", NafConfig, PpoConfig)


class SingleNetworkAgent(Generic[Config]):
    """A network and its optimiser.

    Attributes:
        network: its `actor` is the policy.
        generator: of random draws, on the device.
        scale: (6,) divisors of the observations.
        updates: number of updates made.
    """

    backend = "autograd"
    parts: tuple[str, ...] = ("network", "optimiser", "notes")
    """Attributes in the saved state, besides generator and counter."""
    network: Any

    def __init__(
        self,
        config: Config,
        network: nn.Module,
        seed: int,
        device: torch.device | str,
        epsilon: float = 1e-8,
    ) -> None:
        """Move the network to its device.

        Args:
            config: every number and switch.
            network: initialised, on the CPU.
            seed: of the random draws.
            device: of the network and its updates.
            epsilon: Adam's.
        """
        self.config: Config = config
        self.device, self.updates = torch.device(device), 0
        self.network = network.to(self.device)
        self.optimiser = torch.optim.Adam(
            self.network.parameters(), config.learning_rate, eps=epsilon, fused=True
        )
        self.generator = torch.Generator(self.device).manual_seed(seed)
        self.scale = torch.tensor(config.observation_scale, device=self.device)
        self.notes = RunningMeans()

    @property
    def actor(self) -> Actor:
        """Policy, for scaled observations."""
        actor: Actor = self.network.actor
        return actor

    @property
    def deployed(self) -> Actor:
        """Policy to score and keep: the same actor."""
        return self.actor

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Return normalised actions (N, actions) for raw observations (N, 6), without noise."""
        return self._answer(observation)

    @cached_property
    def _answer(self) -> Answer:
        return Answer(self.actor, self.scale)

    def scaled(self, observation: np.ndarray) -> Tensor:
        """Return the raw observations (N, 6), scaled and on the device."""
        raw = torch.as_tensor(observation, dtype=torch.float32, device=self.device)
        return raw / self.scale

    def anneal(self, progress: float) -> None:
        """Set the learning rate for a run of which the share `progress` is done."""
        share = 1.0 - (1.0 - self.config.learning_rate_end) * min(progress, 1.0)
        for group in self.optimiser.param_groups:
            group["lr"] = share * self.config.learning_rate

    def descend(self, loss: Tensor) -> None:
        """Make one update that reduces a loss."""
        self.optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        if self.config.grad_clip > 0:
            nn.utils.clip_grad_norm_(self.network.parameters(), self.config.grad_clip)
        self.optimiser.step()
        self.updates += 1

    def metrics(self) -> dict[str, float]:
        """Return the means of the values noted since the last call."""
        return self.notes.take()

    def state_dict(self) -> dict[str, Any]:
        """Return the parts, the generator and the counter."""
        state = {name: getattr(self, name).state_dict() for name in self.parts}
        return state | {"generator": self.generator.get_state(), "updates": self.updates}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`, to the bit."""
        for name in self.parts:
            getattr(self, name).load_state_dict(state[name])
        self.generator.set_state(state["generator"].cpu())
        self.updates = int(state["updates"])
