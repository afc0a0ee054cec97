"""Checks of configuration values: each raises ValueError with one line that names the field."""

from __future__ import annotations

import math

from bicycle_sim.config import require


def require_between(name: str, value: float, low: float, high: float) -> None:
    """Check that `low` <= `value` <= `high`.

    Raises:
        ValueError: when it is not.
    """
    require(low <= value <= high, f"{name} must lie within {low} and {high}, not {value!r}")


def require_positive(name: str, value: float) -> None:
    """Check that `value` is finite and above zero.

    Raises:
        ValueError: when it is not.
    """
    require(math.isfinite(value) and value > 0, f"{name} must be above zero, not {value!r}")


def require_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    """Check that `value` is one of `choices`.

    Raises:
        ValueError: when it is not.
    """
    require(value in choices, f"{name} must be one of {', '.join(choices)}, not {value!r}")


def require_layers(name: str, sizes: tuple[int, ...]) -> None:
    """Check that there is a hidden layer and that each has units.

    Raises:
        ValueError: when it is not so.
    """
    require(len(sizes) > 0 and min(sizes) > 0, f"{name} needs sizes above zero, not {sizes}")


def require_scale(name: str, scale: tuple[float, ...]) -> None:
    """Check for one divisor above zero per observation.

    Raises:
        ValueError: when there are not six.
    """
    require(len(scale) == 6 and min(scale) > 0, f"{name} needs six values above zero, not {scale}")
