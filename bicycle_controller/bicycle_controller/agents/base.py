"""What the training loop needs of an algorithm."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from bicycle_controller.networks import Actor
from bicycle_controller.replay import Replay


class Chooser(Protocol):
    """Chooses actions."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Normalised actions (N, actions) for raw observations (N, 6), without noise."""


class Agent(Chooser, Protocol):
    """An off-policy learner with a deterministic actor."""

    @property
    def actor(self) -> Actor:
        """The current policy, for scaled observations."""

    @property
    def deployed(self) -> Actor:
        """The policy to score and keep: the actor, or its running average."""

    def anneal(self, progress: float) -> None:
        """Set the learning rates for a run of which the share `progress` is done."""

    def update(self, replay: Replay, count: int) -> None:
        """Make `count` updates from one draw out of the memory."""

    def metrics(self) -> dict[str, float]:
        """Means of what was logged since the last call."""

    def state_dict(self) -> dict[str, Any]:
        """Networks, targets, optimisers, generators and counters."""

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from `state`, to the bit."""
