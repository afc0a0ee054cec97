"""Hardships of a training episode beside its start, and those that each of N bicycles has."""

from __future__ import annotations

from typing import Any

import numpy as np

from bicycle_controller.config.run import StartsConfig

KINDS = ("speeds", "delay", "kick", "noise")
"""Fields of `StartsConfig`."""


class Hardships:
    """Hardships of N episodes: all that the run names, or one at a time.

    Attributes:
        noise: (N,) standard deviation of the noise on every observation.
    """

    def __init__(self, count: int, starts: StartsConfig, rng: np.random.Generator) -> None:
        """Draw the first ones.

        Args:
            count: N.
            starts: the run's starts.
            rng: source of the draws; nothing is drawn of what the run does not name.
        """
        self._starts, self._rng = starts, rng
        self._named = [kind for kind in KINDS if getattr(starts, kind)]
        self._kind = np.full(count, -1)
        self.noise = np.zeros(count)
        self.draw(np.ones(count, dtype=bool))

    def draw(self, mask: np.ndarray) -> None:
        """Draw those of the episodes that begin, `mask` (N,)."""
        count = int(mask.sum())
        if self._starts.one_hardship and self._named:
            self._kind[mask] = self._rng.integers(-1, len(self._named), count)
        if self._starts.noise > 0:
            drawn = self._rng.uniform(0.0, self._starts.noise, count)
            self.noise[mask] = drawn * self.has("noise")[mask]

    def has(self, kind: str) -> np.ndarray:
        """Return True for the episodes with that hardship, (N,)."""
        if not self._starts.one_hardship:
            return np.full(len(self._kind), kind in self._named)
        return self._kind == (self._named.index(kind) if kind in self._named else len(KINDS))

    def state_dict(self) -> dict[str, Any]:
        """Return the drawn hardships."""
        return {"kind": self._kind.copy(), "noise": self.noise.copy()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`."""
        self._kind, self.noise = state["kind"], state["noise"]
