"""An actor that answers a mirrored state with the mirrored action, by construction.

Its two halves share their weights: one sees the state, the other the state as a mirror shows it,
and the action is the hyperbolic tangent of their difference. As a policy file it is a plain
network of twice the width.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from torch import nn


class MirroredActor(nn.Module):
    """Network from scaled inputs (N, n) to one action in -1..1, (N,)."""

    mirror: torch.Tensor
    """(n,) how a mirror changes each input."""

    def __init__(self, mirror: Sequence[float], hidden: Sequence[int]) -> None:
        """Draw the weights.

        Args:
            mirror: +1 or -1 for each input: how a mirror changes it.
            hidden: widths of the layers of one half.
        """
        super().__init__()
        self.register_buffer("mirror", torch.tensor(list(mirror), dtype=torch.float32))
        widths = [len(self.mirror), *hidden]
        self.hidden_layers = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(widths))
        self.last = nn.Linear(widths[-1], 1, bias=False)
        with torch.no_grad():
            self.last.weight.mul_(0.1)

    def _sum(self, inputs: torch.Tensor) -> torch.Tensor:
        """Return one half's sum, (N, 1)."""
        for layer in self.hidden_layers:
            inputs = torch.relu(layer(inputs))
        out: torch.Tensor = self.last(inputs)
        return out

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """Return the actions, (N,)."""
        both = self._sum(torch.cat([inputs, inputs * self.mirror]))
        one, other = both.chunk(2)
        return torch.tanh(one - other)[:, 0]

    def tensors(self) -> dict[str, np.ndarray]:
        """Return the plain network of twice the width, see `policy_file`."""
        found = {}
        for index, layer in enumerate(self.hidden_layers):
            values = layer.state_dict()
            weight, bias = values["weight"].cpu(), values["bias"].cpu()
            if index == 0:
                whole = torch.cat([weight, weight * self.mirror.cpu()])
            else:
                whole = torch.block_diag(weight, weight)  # type: ignore[no-untyped-call]
            found[f"layer.{index}.weight"] = whole.numpy().astype(np.float32)
            found[f"layer.{index}.bias"] = torch.cat([bias, bias]).numpy().astype(np.float32)
        weight, index = self.last.weight.detach().cpu(), len(self.hidden_layers)
        found[f"layer.{index}.weight"] = torch.cat([weight, -weight], 1).numpy().astype(np.float32)
        found[f"layer.{index}.bias"] = np.zeros(1, dtype=np.float32)
        return found
