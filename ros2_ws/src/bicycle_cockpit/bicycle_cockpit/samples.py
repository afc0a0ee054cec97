"""Data that the page draws of one step, the same for a live ride and for a bag.

SI units and REP-103 signs, as in the messages: lean to the right and angles counter-clockwise
are positive.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bicycle_common.conventions import mirror
from bicycle_sim.task.reward import RewardWeights, reward_terms

DIGITS = 5
"""Decimal places sent to the page: 10 µm, 10 µrad."""


class Sample(NamedTuple):
    """One step; unknown values are NaN."""

    t: float
    """s of simulated time."""
    episode: float
    step: float
    x: float
    """m, rear contact."""
    y: float
    """m, rear contact."""
    heading: float
    """rad, yaw from +x."""
    lean: float
    """rad, positive to the right."""
    lean_rate: float
    """rad/s."""
    steer: float
    """rad, positive to the left."""
    speed: float
    """m/s."""
    goal_distance: float
    """m."""
    heading_error: float
    """rad, positive for a goal to the left."""
    source: float
    """Source of the step's input: a number of BicycleState.SOURCE_*."""
    torque: float
    """N m, positive steers left."""
    displacement: float
    """m of the rider, positive to the left."""
    pedal_force: float
    """N."""
    policy: float
    """Number of the policy that chose these three, in the list sent with the rows."""
    reward_lean: float
    """Terms of equation 20."""
    reward_rate: float
    reward_acceleration: float
    reward_heading: float
    est_t: float = math.nan
    """s, time of the newest estimate of the episode, whose quantities follow; else of the row."""
    est_x: float = math.nan
    """m, rear contact."""
    est_y: float = math.nan
    est_heading: float = math.nan
    est_lean: float = math.nan
    est_steer: float = math.nan
    est_speed: float = math.nan

    @property
    def body(self) -> str:
        """State of the bicycle as text, in which unknown values are alike."""
        return str(self[: self._fields.index("goal_distance")])


ESTIMATED = {
    "est_t": "header.stamp",
    "est_x": "rear_contact.x",
    "est_y": "rear_contact.y",
    "est_heading": "heading",
    "est_lean": "lean_angle",
    "est_steer": "steer_angle",
    "est_speed": "speed",
}
"""Fields of the estimator's BicycleState by column."""

REWARDED = ("lean_angle", "lean_rate", "lean_acceleration", "heading_error")
"""Quantities in equation 20, in its order."""

COLUMNS = Sample._fields
"""Their order in every row sent to the page."""


def reward_columns(state: Mapping[str, Any], weights: RewardWeights) -> list[Any]:
    """Return the four terms of equation 20 of a state, or of columns of states, in REP-103 signs.

    Args:
        state: `lean_angle`, `lean_rate`, `lean_acceleration` and `heading_error`, numbers or
            arrays of one shape.
        weights: of the episode's scenario.
    """
    lean, rate, acceleration, error = (mirror(name, state[name]) for name in REWARDED)
    terms = reward_terms(lean, rate, acceleration, error, weights)
    return [terms[name] for name in REWARDED]


def plain(value: float) -> float | None:
    """Return a number for JSON: rounded, None if it is not finite."""
    return round(value, DIGITS) if math.isfinite(value) else None


def plain_row(sample: Iterable[float]) -> list[float | None]:
    """Return a row for JSON."""
    return [plain(value) for value in sample]


def plain_column(column: NDArray[Any]) -> list[float | None]:
    """Return a column for JSON."""
    numbers = np.round(column.astype(np.float64), DIGITS)
    return [value if math.isfinite(value) else None for value in numbers.tolist()]
