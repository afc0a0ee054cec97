"""What the training loop needs of an algorithm."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from bicycle_controller.agents.networks import Actor


class Chooser(Protocol):
    """Chooses actions."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Normalised actions (N, actions) for raw observations (N, 6), without noise."""


class Memory(Protocol):
    """What an agent learns from: the replay memory, or the rollout of an on-policy learner."""

    def add(self, rows: np.ndarray) -> None:
        """Store transitions (M, width), in the order of `replay.Batch`'s fields."""

    def state_dict(self) -> dict[str, Any]:
        """All that it holds."""

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from `state`."""


class Agent(Chooser, Protocol):
    """A learner with a deterministic actor.

    Attributes:
        backend: what makes its gradients; the same numbers come from the same one only.
    """

    backend: str

    @property
    def actor(self) -> Actor:
        """The current policy, for scaled observations."""

    @property
    def deployed(self) -> Actor:
        """The policy to score and keep: the actor, or its running average."""

    def anneal(self, progress: float) -> None:
        """Set the learning rates for a run of which the share `progress` is done."""

    def update(self, memory: Any, count: int, /) -> None:
        """Make `count` updates from the memory of its kind."""

    def metrics(self) -> dict[str, float]:
        """Means of what was logged since the last call."""

    def state_dict(self) -> dict[str, Any]:
        """Networks, targets, optimisers, generators and counters."""

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from `state`, to the bit."""
