"""Running means of an agent's logged values."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor


class RunningMeans:
    """Sums of scalars on their device, so that adding one does not wait for the device."""

    def __init__(self) -> None:
        self._sums: dict[str, Tensor] = {}
        self._counts: dict[str, int] = {}

    def add(self, **values: Tensor) -> None:
        """Add scalar tensors to the means of those names."""
        for name, value in values.items():
            old = self._sums.get(name)
            self._sums[name] = value.detach() if old is None else old + value.detach()
            self._counts[name] = self._counts.get(name, 0) + 1

    def take(self) -> dict[str, float]:
        """Return the means since the last call."""
        means = {name: float(total) / self._counts[name] for name, total in self._sums.items()}
        self._sums, self._counts = {}, {}
        return means

    def state_dict(self) -> dict[str, Any]:
        """Return the sums and counts."""
        return {name: [total.item(), self._counts[name]] for name, total in self._sums.items()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`."""
        self._sums = {name: torch.tensor(total) for name, (total, _) in state.items()}
        self._counts = {name: count for name, (_, count) in state.items()}
