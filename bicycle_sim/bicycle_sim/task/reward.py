"""Equation 20 of the paper, term by term."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from bicycle_common.geometry import Array
from bicycle_common.validation import require


@dataclass(frozen=True)
class RewardWeights:
    """Weight of each squared quantity (eq. 20); `balance()` is the authors' balance task.

    Raises:
        ValueError: on a weight that is negative or not finite.
    """

    lean_angle: float = 1.0
    lean_rate: float = 0.1
    lean_acceleration: float = 0.01
    heading_error: float = 2.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            require(
                math.isfinite(value) and value >= 0,
                f"{item.name} must be zero or more and finite, not {value!r}",
            )

    @classmethod
    def balance(cls) -> RewardWeights:
        """Return the weights of the authors' balance task, derived from eq. 20 (errata row 40)."""
        return cls(lean_angle=0.01, lean_rate=0.1, lean_acceleration=1.0, heading_error=0.0)


def reward_terms(
    lean_angle: Array,
    lean_rate: Array,
    lean_acceleration: Array,
    heading_error: Array,
    weights: RewardWeights,
) -> dict[str, Array]:
    """Return each term of eq. 20, shape (N,), never positive; their sum is the reward."""
    return {
        "lean_angle": -weights.lean_angle * lean_angle * lean_angle,
        "lean_rate": -weights.lean_rate * lean_rate * lean_rate,
        "lean_acceleration": -weights.lean_acceleration * lean_acceleration * lean_acceleration,
        "heading_error": -weights.heading_error * heading_error * heading_error,
    }
