"""Options of `reset`: where the bicycles start and where they ride to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from bicycle_common.validation import nearest, require
from bicycle_sim.task.scenario import Scenario

MASK = "reset_mask"
_WIDTHS = {"start": 2, "goal": 2, "heading": 0, "speed": 0}
"""Numbers of each option for one bicycle; 0 for a plain number."""


@dataclass(frozen=True)
class ResetOptions:
    """Options of `reset(options=...)`; None for those that are drawn."""

    start: np.ndarray | None = None
    """(N, 2) m, rear contacts."""
    goal: np.ndarray | None = None
    """(N, 2) m."""
    heading: np.ndarray | None = None
    """(N,) rad, counter-clockwise from +y."""
    speed: np.ndarray | None = None
    """(N,) m/s."""
    mask: np.ndarray | None = None
    """(N,) bool: the bicycles that begin an episode; the others ride on."""


def read(
    options: Mapping[str, Any] | None, count: int, scenario: Scenario, many: bool
) -> ResetOptions:
    """Check and convert the options of `count` bicycles.

    Args:
        options: `start` and `goal` (x, y) m, `heading` rad and `speed` m/s, for all bicycles or
            with one row for each; with `many` also `reset_mask`, (N,) bool.
        count: N.
        scenario: its speed limits bound the speed.
        many: True if this is a vector environment.

    Raises:
        ValueError: on an unknown option, or a value of a wrong shape or out of range.
    """
    given = dict(options or {})
    known = [*_WIDTHS, *([MASK] if many else [])]
    for name in given:
        require(
            name in known,
            f"unknown reset option {name!r}{nearest(name, known)}; known: {', '.join(known)}",
        )
    mask = given.pop(MASK, None)
    values = {name: _rows(name, value, count) for name, value in given.items()}
    if "speed" in values:
        low, high = scenario.speed_limits or (0.0, np.inf)
        speed = values["speed"]
        require(
            bool(((speed > 0) & (speed >= low) & (speed <= high)).all()),
            f"option speed must be above zero and within {low}..{high} m/s",
        )
    return ResetOptions(mask=None if mask is None else _mask(mask, count), **values)


def _rows(name: str, value: Any, count: int) -> np.ndarray:
    """Return an option as one row for each bicycle."""
    width = _WIDTHS[name]
    shape = (count, width) if width else (count,)
    alike = f"{width} numbers" if width else "a number"
    message = f"option {name} must be {alike}, or {count} such, finite; not {value!r}"
    try:
        array = np.asarray(value, dtype=float)
        require(array.shape in (shape, shape[1:]), message)
        require(bool(np.isfinite(array).all()), message)
    except (TypeError, ValueError):
        raise ValueError(message.replace("\n", " ")) from None
    return np.broadcast_to(array, shape)


def _mask(value: Any, count: int) -> np.ndarray:
    mask = np.asarray(value)
    require(
        mask.shape == (count,) and mask.dtype == bool and bool(mask.any()),
        f"option {MASK} must be {count} booleans, at least one of them True",
    )
    return mask
