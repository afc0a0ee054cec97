"""A rule by which bicycles keep clear: who gives way slows down, and swerves if it must.

Two bicycles whose straight prediction brings them too near are in conflict. The one that has the
other come from its right gives way; where that does not decide (one behind the other), the one
behind does, and else the one whose name comes later. It takes the highest speed, and the
smallest shift to the side, at which the two stay clear. The other one rides on, unless they are
about to touch: then it moves aside, too. Head on, both keep to the right.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

UNHEARD = "bicycles not heard"
"""Key of a controller's diagnostics that names bicycles without a received state."""
LOOK_PERIOD = 0.1
"""s between two looks at the other bicycles; one rides half a metre meanwhile."""
CLEAR = 3.0
"""Distance between two rear contacts that is kept, m."""
HORIZON = 10.0
"""s of prediction."""
URGENT = 2.5
"""s before contact within which the bicycle with priority moves aside, too."""
HEAD_ON = np.radians(165.0)
"""Angle between two headings beyond which bicycles meet head on, rad."""
ASIDE = 2.0
"""m by which each of two bicycles moves aside that meet head on."""
AGAINST = np.radians(120.0)
"""Angle between two headings beyond which no bicycle swerves to the left, rad."""
KEEP = 0.5
"""m of clearance that another shift must gain to be taken instead of the last one."""
PASSING = 4.5
"""m between two that meet head on, below which both keep to the right."""
SAME_WAY = np.radians(20.0)
"""Angle between two headings up to which bicycles ride the same way, rad."""
SHIFTS = (0.0, -1.5, 1.5, -3.0, 3.0)
"""m to the left of the path that are tried; to the right first, as on a road."""
SPEEDS = 9
"""Speeds that are tried, from the wanted one down to the slowest."""


class Mover(NamedTuple):
    """N bicycles; arrays of (N,)."""

    x: np.ndarray
    """m."""
    y: np.ndarray
    """m."""
    heading: np.ndarray
    """rad, psi."""
    speed: np.ndarray
    """m/s."""


class Way(NamedTuple):
    """Orders for N riding bicycles; arrays of (N,)."""

    speed: np.ndarray
    """m/s."""
    shift: np.ndarray
    """m to the left of the path."""
    yields: np.ndarray
    """bool: True if it gives way."""


def keep_clear(
    own: Mover,
    other: Mover,
    later: np.ndarray,
    wanted: np.ndarray,
    slowest: np.ndarray | float,
    beside: np.ndarray | float = 0.0,
    last: np.ndarray | float = 0.0,
    shifts: Sequence[float] = SHIFTS,
    against: float = AGAINST,
    side: float = 0.0,
) -> Way:
    """Return how each bicycle rides past its other one.

    Args:
        own: the bicycles; their headings are those of their paths, since a swerve is passing.
        other: one for each.
        later: (N,) bool, True where the own name comes after the other's.
        wanted: (N,) m/s.
        slowest: (N,) m/s; `wanted` where the speed cannot be changed.
        beside: (N,) m, where the own bicycle is, to the left of its path.
        last: (N,) m, its last shift, which it keeps unless another one is clearly better.
        shifts: m to the left of the path that are tried, the first of equals wins.
        against: rad between two headings beyond which it does not swerve to the left.
        side: m of clearance that the other side must gain to be taken instead of the last one.
    """
    wanted = np.asarray(wanted, dtype=float)
    miss, soon = _miss(own, other, own.speed, 0.0)
    planned, _ = _miss(own, other, np.maximum(wanted, own.speed), 0.0)
    back, _ = _miss(own, other, own.speed, -beside)  # if it returned to its path
    conflict = np.minimum(np.minimum(miss, planned), back) < CLEAR
    yields = conflict & _gives_way(own, other, later)
    urgent = conflict & (miss < 0.5 * CLEAR) & (soon < URGENT)
    acts = yields | urgent
    angle = np.abs(np.angle(np.exp(1j * (other.heading - own.heading))))
    best = np.full(len(wanted), -np.inf)
    speed, shift = wanted.copy(), np.zeros(len(wanted))
    for aside in shifts if acts.any() else ():  # nearly all of the work, seldom needed
        for share in np.linspace(1.0, 0.0, SPEEDS):
            tried = slowest + share * np.maximum(wanted - slowest, 0.0)
            found, _ = _miss(own, other, tried, aside - beside)
            # Of all clear ways, take the first: it is the fastest and straightest.
            score = np.minimum(found, CLEAR) - 0.02 * abs(aside) - 0.01 * (1.0 - share)
            if aside > 0.0:  # who comes against it may keep to its right
                score = score - np.where(angle > against, CLEAR, 0.0)
            score = score + np.where(np.abs(last - aside) < 0.1, KEEP, 0.0)
            score = score + np.where(last * aside > 0.0, side, 0.0)
            better = score > best + 1e-9
            best = np.where(better, score, best)
            speed = np.where(acts & better, tried, speed)
            shift = np.where(acts & better, aside, shift)
    # Head on both keep to the right, as on a road: neither has time to find out who yields.
    head_on = (angle > HEAD_ON) & (soon > 0.0) & (np.minimum(miss, back) < PASSING)
    shift = np.where(head_on, -ASIDE, shift)
    speed = np.where(head_on, wanted, speed)
    return Way(speed, shift, acts | head_on)


def _miss(
    own: Mover, other: Mover, speed: np.ndarray, aside: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the least distance of two straight predictions, m, and when it comes, s."""
    fx, fy = -np.sin(own.heading), np.cos(own.heading)
    dx = other.x - (own.x - aside * fy)
    dy = other.y - (own.y + aside * fx)
    wx = -np.sin(other.heading) * other.speed - fx * speed
    wy = np.cos(other.heading) * other.speed - fy * speed
    square = np.maximum(wx * wx + wy * wy, 1e-6)
    time = np.clip(-(dx * wx + dy * wy) / square, 0.0, HORIZON)
    return np.hypot(dx + time * wx, dy + time * wy), time


def _gives_way(own: Mover, other: Mover, later: np.ndarray) -> np.ndarray:
    """Return True where the own bicycle gives way."""
    mine = _bearing(own, other)
    theirs = _bearing(other, own)
    behind = np.radians(110.0)
    # By the headings alone, which hold while both ride on: a bearing changes as they come near.
    across = np.angle(np.exp(1j * (other.heading - own.heading)))
    right, left = across > SAME_WAY, across < -SAME_WAY
    back = (np.abs(mine) < behind) & (np.abs(theirs) >= behind)
    front = (np.abs(theirs) < behind) & (np.abs(mine) >= behind)
    along = np.where(back, True, np.where(front, False, later))
    return np.asarray(np.where(right | left, right, along), dtype=bool)


def _bearing(own: Mover, other: Mover) -> np.ndarray:
    """Return the direction to the other, rad, positive to the left of the heading."""
    angle = np.arctan2(-(other.x - own.x), other.y - own.y) - own.heading
    return np.asarray(np.angle(np.exp(1j * angle)))
