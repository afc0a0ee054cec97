"""A rule by which bicycles keep clear: who gives way slows down, and swerves if it must.

Two bicycles whose straight prediction brings them too near are in conflict. The one that has the
other on its right gives way; where that does not decide (head on, or one behind the other), the
one behind does, and else the one whose name comes later. It takes the highest speed, and the
smallest shift to the side, at which the two stay clear. The other one rides on, unless they are
about to touch: then it moves aside, too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

CLEAR = 3.0
"""Distance between two rear contacts that is kept, m."""
HORIZON = 10.0
"""s of prediction."""
URGENT = 2.5
"""s before a touch within which who has priority moves aside, too."""
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
    own: Mover, other: Mover, later: np.ndarray, wanted: np.ndarray, slowest: float
) -> Way:
    """Return how each bicycle rides past its other one.

    Args:
        own: the bicycles.
        other: one for each.
        later: (N,) bool, True where the own name comes after the other's.
        wanted: (N,) m/s.
        slowest: m/s.
    """
    wanted = np.asarray(wanted, dtype=float)
    miss, soon = _miss(own, other, own.speed, 0.0)
    planned, _ = _miss(own, other, np.maximum(wanted, own.speed), 0.0)
    conflict = np.minimum(miss, planned) < CLEAR
    yields = conflict & _gives_way(own, other, later)
    urgent = conflict & (miss < 0.5 * CLEAR) & (soon < URGENT)
    acts = yields | urgent
    best = np.full(len(wanted), -np.inf)
    speed, shift = wanted.copy(), np.zeros(len(wanted))
    for aside in SHIFTS:
        for share in np.linspace(1.0, 0.0, SPEEDS):
            tried = slowest + share * np.maximum(wanted - slowest, 0.0)
            found, _ = _miss(own, other, tried, aside)
            # Clear is clear: among those the first, fastest and straightest, is taken.
            score = np.minimum(found, CLEAR) - 0.02 * abs(aside) - 0.01 * (1.0 - share)
            better = score > best + 1e-9
            best = np.where(better, score, best)
            speed = np.where(acts & better, tried, speed)
            shift = np.where(acts & better, aside, shift)
    return Way(speed, shift, acts)


def _miss(
    own: Mover, other: Mover, speed: np.ndarray, aside: float
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
    ahead, behind = np.radians(20.0), np.radians(110.0)
    right = (mine < -ahead) & (mine > -behind)
    left = (theirs < -ahead) & (theirs > -behind)  # it has me on its right
    back = (np.abs(mine) < behind) & (np.abs(theirs) >= behind)
    front = (np.abs(theirs) < behind) & (np.abs(mine) >= behind)
    decided = np.where(back, True, np.where(front, False, np.where(right != left, right, later)))
    return np.asarray(decided, dtype=bool)


def _bearing(own: Mover, other: Mover) -> np.ndarray:
    """Return the direction to the other, rad, positive to the left of the heading."""
    angle = np.arctan2(-(other.x - own.x), other.y - own.y) - own.heading
    return np.asarray(np.angle(np.exp(1j * angle)))
