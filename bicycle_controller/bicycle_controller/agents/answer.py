"""Fast inference of an actor during training; with one bicycle the cost per call dominates."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from bicycle_controller.agents.networks import Actor, linear_layers


class Answer:
    """Actions of an actor for raw observations, bit-equal to calling the actor.

    A plain actor on the CPU is decomposed into its matrix products. Others are called as they are.
    """

    def __init__(self, actor: Actor, scale: Tensor) -> None:
        """Keep references to the actor's parameters, which must be changed in place.

        Args:
            actor: on its device.
            scale: (inputs,) divisors of the observations, on the same device.
        """
        self._actor, self._scale = actor, scale
        self._divisor = scale.cpu().numpy()
        layers = linear_layers(actor)
        parts = [(layer.weight.detach(), layer.bias.detach()) for layer in layers]
        self._hidden, self._last = parts[:-1], parts[-1]
        self._plain = scale.device.type == "cpu" and not actor.norms and not actor.symmetric

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Return normalised actions (N, actions) for raw observations (N, inputs)."""
        if not self._plain:
            return self._called(observation)
        x = torch.from_numpy(observation.astype(np.float32) / self._divisor)
        for weight, bias in self._hidden:
            x = torch.relu_(torch.nn.functional.linear(x, weight, bias))
        action: np.ndarray = torch.tanh_(torch.nn.functional.linear(x, *self._last)).numpy()
        return action

    @torch.no_grad()
    def _called(self, observation: np.ndarray) -> np.ndarray:
        raw = torch.as_tensor(observation, dtype=torch.float32, device=self._scale.device)
        action: np.ndarray = self._actor(raw / self._scale).cpu().numpy()
        return action
