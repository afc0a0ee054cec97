"""Interface of an algorithm, as the training loop uses it."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from bicycle_controller.agents.networks import Actor


class Chooser(Protocol):
    """Chooses actions."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Return normalised actions (N, actions) for raw (N, inputs), without noise."""


class Memory(Protocol):
    """Source of an agent's data: the replay memory, or the rollout of an on-policy learner."""

    def add(self, rows: np.ndarray) -> None:
        """Store transitions (M, width), in the order of `replay.Batch`'s fields."""

    def state_dict(self) -> dict[str, Any]:
        """Return its whole state."""

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`."""


class Agent(Chooser, Protocol):
    """A learner with a deterministic actor.

    Attributes:
        backend: implementation of the gradients; only the same one gives the same numbers.
    """

    backend: str

    @property
    def actor(self) -> Actor:
        """Current policy, for scaled observations."""

    @property
    def deployed(self) -> Actor:
        """Policy to score and keep: the actor, or its running average."""

    def anneal(self, progress: float) -> None:
        """Set the learning rates for a run of which the share `progress` is done."""

    def update(self, memory: Any, count: int, /) -> None:
        """Make `count` updates from the agent's memory."""

    def metrics(self) -> dict[str, float]:
        """Return the means of the values logged since the last call."""

    def state_dict(self) -> dict[str, Any]:
        """Return the networks, targets, optimisers, generators and counters."""

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`, to the bit."""
