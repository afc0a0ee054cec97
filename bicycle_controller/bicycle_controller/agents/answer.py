"""An actor's answers while it learns, in few calls: for one bicycle the calls are what counts."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from bicycle_controller.agents.networks import Actor, linear_layers


class Answer:
    """An actor's actions for raw observations; the bits of calling the actor.

    A plain actor on the CPU is taken apart into its products. Another one is called as it is.
    """

    def __init__(self, actor: Actor, scale: Tensor) -> None:
        """Keep the actor's parameters where they are: who changes them does so in place.

        Args:
            actor: on its device.
            scale: (6,) that observations are divided by, on the same device.
        """
        self._actor, self._scale = actor, scale
        self._divisor = scale.cpu().numpy()
        layers = linear_layers(actor)
        parts = [(layer.weight.detach(), layer.bias.detach()) for layer in layers]
        self._hidden, self._last = parts[:-1], parts[-1]
        self._plain = scale.device.type == "cpu" and not actor.norms and not actor.symmetric

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Normalised actions (N, actions) for raw observations (N, 6)."""
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
