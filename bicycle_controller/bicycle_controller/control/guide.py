"""Guides steer in place of the policy, along a path or by a commanded turn."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

import numpy as np

from bicycle_common.types import BicycleState


class PathEnd(IntEnum):
    """Status of a path; the numbers are those of PathStatus."""

    ACTIVE = 0
    FINISHED = 1
    LOST = 2
    REPLACED = 3
    FALLEN = 4
    REJECTED = 5
    CANCELLED = 6


@dataclass(frozen=True)
class PathReport:
    """Progress along a path."""

    path_id: int
    name: str
    status: PathEnd
    lap: int
    laps: int
    along: float
    """m from the start of the first lap, which on a loop is where it was joined."""
    length: float
    """m of all laps."""
    cross_track: float
    """m, positive to the left of the path."""
    heading_error: float
    """rad, positive if the bicycle points to the left of the path."""
    wanted_speed: float
    """m/s."""
    rms: float
    """m, root of the mean squared cross-track error so far."""
    largest: float
    """m, its largest size so far."""
    elapsed: float
    """s of simulated time."""
    message: str


@dataclass(frozen=True)
class PlannedTurns:
    """Steady turns that a guide may ride about now: from `right` to `left` times the one named.

    The safety layer judges a bicycle by what it is beside these turns. Arrays of (N,).
    """

    lean: np.ndarray
    """rad in the named turn, which is to the left; as in an observation."""
    steer: np.ndarray
    """rad in it."""
    torque: np.ndarray
    """N m that holds it."""
    right: np.ndarray
    """Share of the named turn, zero or less."""
    left: np.ndarray
    """Share of the named turn, zero or more."""
    room: float = 1.0
    """Times the limit of extrapolated lean that the guide is trusted with."""


_NOTHING = np.zeros(1)
ANY_TURN = PlannedTurns(_NOTHING, _NOTHING, _NOTHING, _NOTHING, _NOTHING, room=math.inf)
"""Turns of a guide that is trusted with each of them."""


class Guide(Protocol):
    """Steers one bicycle in place of the policy."""

    @property
    def policy_id(self) -> str:
        """Id that every command carries."""
        ...

    @property
    def over(self) -> bool:
        """True if it has nothing more to do: the policy steers again."""
        ...

    def act(self, snapshot: BicycleState, time: float) -> np.ndarray:
        """Return the action (3,), N m, m, N, for a state at a simulated time, s."""
        ...

    def turns(self, speed: float) -> PlannedTurns | None:
        """Return the turns that it may ride about now, at a speed, m/s; None if it cannot tell."""
        ...

    def heading_error(self, snapshot: BicycleState) -> float:
        """Return psi_g, rad, by which the fallback steers in its place."""
        ...

    def end(self, status: PathEnd, why: str) -> None:
        """Stop steering."""
        ...
