"""Parameters to plain data, as JSON and YAML have them, and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np

from bicycle_common.validation import reject_unknown, require
from bicycle_sim.plants.whipple.parameters import (
    Bicycle,
    Drive,
    Motor,
    Parameters,
    Resistance,
    Rider,
    Road,
    Steering,
)

Part = TypeVar("Part")

PARTS: dict[str, type] = {
    "bicycle": Bicycle,
    "rider": Rider,
    "steering": Steering,
    "motor": Motor,
    "drive": Drive,
    "resistance": Resistance,
    "road": Road,
}
"""The parts of `Parameters` that are dataclasses of their own."""


def to_dict(part: object) -> dict[str, Any]:
    """Plain data, arrays as lists."""
    plain: dict[str, Any] = {}
    for item in fields(part):  # type: ignore[arg-type]
        value = getattr(part, item.name)
        if is_dataclass(value):
            plain[item.name] = to_dict(value)
        else:
            plain[item.name] = value.tolist() if isinstance(value, np.ndarray) else value
    return plain


def _number(value: Any) -> Any:
    """Convert lists to arrays, and numbers such as 1e-3, which YAML takes for text, to numbers."""
    if isinstance(value, list):
        try:
            return np.array(value, dtype=float)
        except (TypeError, ValueError):
            return value
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            return value
    return value


def make(kind: type[Part], data: object) -> Part:
    """Return a part from plain data.

    Raises:
        ValueError: on an unknown or missing key, naming it, or on a value that makes no sense.
    """
    name = kind.__name__.lower()
    if not isinstance(data, Mapping):
        raise ValueError(f"{name} must be a mapping, not {type(data).__name__}")
    reject_unknown(kind, dict(data))
    values = {key: _number(value) for key, value in data.items()}
    needed = [
        item.name
        for item in fields(kind)  # type: ignore[arg-type]
        if item.default is item.default_factory and item.name not in values
    ]
    require(not needed, f"{name} lacks {', '.join(needed)}")
    return kind(**values)


def from_dict(data: object) -> Parameters:
    """Return parameters from plain data, as `to_dict` gives them.

    Raises:
        ValueError: on an unknown or missing key, naming it, or on a value that makes no sense.
    """
    if not isinstance(data, Mapping):
        raise ValueError(f"the parameters must be a mapping, not {type(data).__name__}")
    values = {
        key: make(PARTS[key], value) if key in PARTS and value is not None else value
        for key, value in data.items()
    }
    return make(Parameters, values)
