"""Network of a policy in torch: to check exports, and to evaluate on a GPU."""

from __future__ import annotations

import numpy as np
import torch
from torch import nn

from bicycle_controller.control.past import Past
from bicycle_controller.policy.policy import NORM_EPSILON, Policy


class TorchPolicy:
    """Same actor as a `Policy`, on any device of torch."""

    def __init__(self, policy: Policy, device: str = "cpu") -> None:
        """Copy the weights to `device`."""
        self.policy_id = policy.policy_id
        self.memory, self.plant_parameters = policy.memory, policy.plant_parameters
        self._inputs = policy.inputs
        self.device = torch.device(device)
        self.network = network(policy).to(self.device)
        limits = np.array(policy.info.action_limits)
        self._driven = limits > 0
        self._limits = limits[self._driven]
        self._scale = np.array(policy.info.observation_scale)

    def act(
        self,
        observation: np.ndarray,
        speed: np.ndarray | None = None,
        past: Past | None = None,
    ) -> np.ndarray:
        """Return the same actions as `Policy.act`."""
        return self.answer(self._inputs.gather(observation, speed, past))

    def answer(self, inputs: np.ndarray) -> np.ndarray:
        """Return the same actions as `Policy.answer`."""
        scaled = torch.as_tensor(inputs / self._scale, dtype=torch.float32)
        with torch.inference_mode():
            outputs = self.network(scaled.to(self.device)).cpu().numpy()
        action = np.zeros((len(inputs), 3))
        action[:, self._driven] = outputs * self._limits
        return action


def network(policy: Policy) -> nn.Sequential:
    """Return the layers of `policy`, from scaled observations to actions in -1..1."""
    tensors = {name: torch.from_numpy(value.copy()) for name, value in policy.tensors.items()}
    count = sum(name.startswith("layer.") for name in tensors) // 2
    parts: list[nn.Module] = []
    for index in range(count):
        weight, bias = tensors[f"layer.{index}.weight"], tensors[f"layer.{index}.bias"]
        linear = nn.Linear(weight.shape[1], weight.shape[0])
        linear.load_state_dict({"weight": weight, "bias": bias})
        parts.append(linear)
        if f"norm.{index}.weight" in tensors:
            norm = nn.LayerNorm(len(bias), eps=NORM_EPSILON)
            names = ("weight", "bias")
            norm.load_state_dict({name: tensors[f"norm.{index}.{name}"] for name in names})
            parts.append(norm)
        parts.append(nn.ReLU() if index < count - 1 else nn.Tanh())
    return nn.Sequential(*parts)
