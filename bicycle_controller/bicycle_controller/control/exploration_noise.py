"""Exploration noise for N bicycles, in normalised actions; numpy only, for the controller."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from bicycle_common.validation import require_between, require_choice


@dataclass(frozen=True)
class NoiseConfig:
    """Exploration noise, in normalised actions (errata row 31).

    Raises:
        ValueError: on a value out of range.
    """

    kind: str
    """`ou` (Ornstein-Uhlenbeck, Table 3), `gaussian` or `none`."""
    sigma: float
    """Standard deviation of each step's random part (Table 3, errata row 31)."""
    theta: float
    """Pull of `ou` towards zero per step (Table 3)."""
    sigma_max: float = 0.0
    """Largest sigma, if above `sigma`: the bicycles' sigmas are spread evenly between the two."""

    def __post_init__(self) -> None:
        require_choice("noise.kind", self.kind, ("ou", "gaussian", "none"))
        for name in ("sigma", "sigma_max"):
            require_between(f"noise.{name}", getattr(self, name), 0.0, math.inf)
        require_between("noise.theta", self.theta, 0.0, 1.0)


pass


class Noise:
    """One noise process per bicycle and action.

    Ornstein-Uhlenbeck as the paper's authors ran it (errata row 31): each step adds
    -theta * noise + sigma * normal, without the square root of dt. Gaussian noise has no
    memory. Both start each episode at zero.
    """

    def __init__(
        self, config: NoiseConfig, count: int, actions: int, rng: np.random.Generator
    ) -> None:
        """Start at zero.

        Args:
            config: kind and size.
            count: N, the number of bicycles.
            actions: numbers per action.
            rng: generator of the normal numbers.
        """
        self.config = config
        self.rng = rng
        self.value = np.zeros((count, actions))
        last = max(config.sigma, config.sigma_max)
        self.sigma = np.linspace(config.sigma, last, count)[:, None]

    def sample(self) -> np.ndarray:
        """Return the noise of the next step, (N, actions)."""
        if self.config.kind == "none":
            return self.value.copy()
        fresh = self.sigma * self.rng.standard_normal(self.value.shape)
        keep = 1.0 - self.config.theta if self.config.kind == "ou" else 0.0
        self.value = keep * self.value + fresh
        return self.value.copy()

    def reset(self, mask: np.ndarray) -> None:
        """Reset the noise of the bicycles of `mask`, bool (N,), whose episode has ended."""
        self.value[mask] = 0.0

    def state_dict(self) -> dict[str, Any]:
        """Return the state for a resumed run."""
        return {"value": self.value.copy(), "rng": self.rng.bit_generator.state}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`."""
        self.value = np.array(state["value"], dtype=np.float64)
        self.rng.bit_generator.state = state["rng"]
