"""Checks of parameters that are a float, or an array with a number for each bicycle."""

from __future__ import annotations

from dataclasses import fields, is_dataclass

import numpy as np

from bicycle_sim.plants.base import Array


def require_good(value: Array, good: Array, message: str) -> None:
    """Raise ValueError with `message` and the first value that is not good, if there is one."""
    if not np.all(good):
        wrong = np.broadcast_to(value, np.shape(good))[~np.asarray(good)]
        raise ValueError(f"{message}, not {wrong.flat[0]:g}")


def require_above(part: object, names: str, low: float, allowed: bool, why: str) -> None:
    """Require that each of `names` lies above `low`, or is equal to it where `allowed`."""
    for name in names.split():
        value = getattr(part, name)
        good = np.greater_equal(value, low) if allowed else np.greater(value, low)
        require_good(value, good, f"{name} must be {why}")


def require_finite(part: object) -> None:
    """Require numbers that are finite in every field that is no part of its own."""
    for item in fields(part):  # type: ignore[arg-type]
        value = getattr(part, item.name)
        if is_dataclass(value) or value is None or item.name == "name":
            continue
        if isinstance(value, (bool, str, list, dict)) or np.asarray(value).dtype.kind not in "fiu":
            raise ValueError(f"{item.name} must be a number, not {value!r}")
        require_good(value, np.isfinite(value), f"{item.name} must be finite")
        if not isinstance(value, np.ndarray):
            object.__setattr__(part, item.name, float(value))


def require_inertia(part: object, body: str) -> None:
    """Require that no axis of a body symmetric about y = 0 has a negative inertia."""
    xx, zz, xz = (getattr(part, f"I{body}{axis}") for axis in ("xx", "zz", "xz"))
    require_above(part, f"I{body}xx I{body}yy I{body}zz", 0.0, True, "zero or more kg m^2")
    require_good(
        xz,
        np.less_equal(xz * xz, xx * zz * (1.0 + 1e-9)),
        f"the square of I{body}xz must be at most I{body}xx times I{body}zz",
    )
