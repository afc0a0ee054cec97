"""Paths to follow: their geometry by arc length, for N bicycles on P paths at once.

Headings use the paper's signs: psi counter-clockwise from +y; a curvature is positive to the left,
and so is a cross-track error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bicycle_common.geometry import wrap_angle
from bicycle_common.validation import require

SPACING = 0.1
"""Distance between the samples of a path, m."""
BACK, AHEAD = 15, 30
"""Samples behind and before the last closest one among which the next is searched."""
TURNING = 3.0
"""Distance that a wrong direction of one radian counts as, where a path is joined, m."""
LONGEST = 200_000.0
"""Longest path, m: two million samples."""


@dataclass(frozen=True)
class Path:
    """One path, sampled at equal distances; every array is (M,)."""

    x: np.ndarray
    """m."""
    y: np.ndarray
    """m."""
    heading: np.ndarray
    """rad, without jumps of a full turn."""
    curvature: np.ndarray
    """1/m, positive to the left."""
    spacing: float
    """m between samples."""
    closed: bool = False
    """True for a loop: the last sample is the first one again."""
    notes: tuple[str, ...] = ()
    """Changes to the points that the path was made from, one line each."""

    @property
    def length(self) -> float:
        """m, of one lap."""
        return self.spacing * (len(self.x) - 1)

    @property
    def sharpest(self) -> float:
        """Largest curvature, 1/m."""
        return float(np.abs(self.curvature).max())


def sampled(x: np.ndarray, y: np.ndarray, closed: bool = False, notes: Sequence[str] = ()) -> Path:
    """Return the path through dense points of a smooth curve, (K,) m each.

    Raises:
        ValueError: if it is shorter than a metre or longer than LONGEST, or not finite.
    """
    require(bool(np.isfinite(x).all() and np.isfinite(y).all()), "a path's points must be finite")
    steps = np.hypot(np.diff(x), np.diff(y))
    keep = np.concatenate([[True], steps > 1e-9])
    x, y = x[keep], y[keep]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    length = float(along[-1])
    require(length >= 1.0, f"a path of {length:.2f} m is too short: give at least 1 m")
    require(length <= LONGEST, f"a path of {length:.7g} m is longer than {LONGEST:g} m")
    count = max(8, round(length / SPACING)) + 1
    at = np.linspace(0.0, length, count)
    x, y = np.interp(at, along, x), np.interp(at, along, y)
    dx, dy = _slope(x, closed), _slope(y, closed)
    heading = np.unwrap(np.arctan2(-dx, dy))
    if closed:
        turns = round((heading[-1] - heading[0]) / (2.0 * np.pi))
        heading[-1] = heading[0] + 2.0 * np.pi * turns
    spacing = length / (count - 1)
    return Path(x, y, heading, _rate(heading, closed) / spacing, spacing, closed, tuple(notes))


def _slope(values: np.ndarray, closed: bool) -> np.ndarray:
    """Central differences, twice the change per sample."""
    if closed:
        inner = values[:-1]
        slope = np.roll(inner, -1) - np.roll(inner, 1)
        return np.append(slope, slope[0])
    return np.gradient(values, edge_order=2) * 2.0


def _rate(heading: np.ndarray, closed: bool) -> np.ndarray:
    """Change of the heading per sample."""
    if not closed:
        return np.asarray(np.gradient(heading))
    steps = np.diff(heading)
    rate = 0.5 * (steps + np.roll(steps, 1))
    return np.append(rate, rate[0])


@dataclass(frozen=True)
class Place:
    """Places of N bicycles on their paths; every field is (N,)."""

    along: np.ndarray
    """m from the path's start; it grows beyond the length on a loop."""
    cross_track: np.ndarray
    """m to the left of the path."""
    heading_error: np.ndarray
    """rad, positive if the bicycle points to the left of the path."""
    curvature: np.ndarray
    """1/m of the path there."""


class Paths:
    """P paths together, and which one each of N bicycles rides.

    Attributes:
        index: (N,) path of each bicycle.
        lengths: (P,) m.
        closed: (P,) bool.
    """

    def __init__(self, paths: Sequence[Path], index: np.ndarray | None = None) -> None:
        """Stack paths; bicycle n rides path n, or `index[n]`."""
        self.paths = tuple(paths)
        self.index = np.arange(len(paths)) if index is None else np.asarray(index)
        self.counts = np.array([len(path.x) for path in paths])
        self.spacings = np.array([path.spacing for path in paths])
        self.lengths = self.spacings * (self.counts - 1)
        self.closed = np.array([path.closed for path in paths])
        self.starts = np.concatenate([[0], np.cumsum(self.counts)[:-1]])
        for name in ("x", "y", "heading", "curvature"):
            setattr(self, f"_{name}", np.concatenate([getattr(path, name) for path in paths]))
        self._laps = np.array([path.heading[-1] - path.heading[0] for path in paths])

    _x: np.ndarray
    _y: np.ndarray
    _heading: np.ndarray
    _curvature: np.ndarray

    @property
    def length(self) -> np.ndarray:
        """(N,) m of each bicycle's path."""
        return np.asarray(self.lengths[self.index])

    def keep(self, mask: np.ndarray) -> Paths:
        """Return the paths of the bicycles of `mask` (N,) only."""
        kept = object.__new__(Paths)
        kept.__dict__.update(self.__dict__)
        kept.index = self.index[mask]
        return kept

    def values(self, table: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Interpolate one number per sample.

        Args:
            table: of all paths' samples, one after another.
            along: (N,) or (N, K) m from the start; beyond the ends of an open path the end holds.
        """
        below, share = self._find(along)
        return np.asarray(table[below] * (1.0 - share) + table[below + 1] * share)

    def curvature(self, along: np.ndarray) -> np.ndarray:
        """Return the curvature, 1/m, at distances (N,) or (N, K); zero beyond an open end."""
        found = self.values(self._curvature, along)
        length, closed = self._of(self.lengths, along), self._of(self.closed, along)
        return np.where(closed | ((along >= 0.0) & (along <= length)), found, 0.0)

    def point(self, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return x and y, m, at distances (N,) or (N, K)."""
        return self.values(self._x, along), self.values(self._y, along)

    def join(self, x: np.ndarray, y: np.ndarray, heading: np.ndarray) -> np.ndarray:
        """Return the distances (N,) at which bicycles best join: near, and in their direction."""
        found = np.zeros(len(x))
        for n, path in enumerate(self.index):
            first, count = self.starts[path], self.counts[path]
            part = slice(first, first + count)
            off = np.abs(wrap_angle(heading[n] - self._heading[part]))
            far = np.hypot(self._x[part] - x[n], self._y[part] - y[n])
            found[n] = np.argmin(far + TURNING * off) * self.spacings[path]
        return found

    def locate(
        self, along: np.ndarray, x: np.ndarray, y: np.ndarray, heading: np.ndarray
    ) -> Place:
        """Find the closest places near the last ones.

        Args:
            along: (N,) m, where the bicycles were one step before.
            x: (N,) m.
            y: (N,) m.
            heading: (N,) rad.
        """
        spacing, length = self.spacings[self.index], self.length
        closed = self.closed[self.index]
        lap = np.where(closed, np.floor(along / length), 0.0)
        sample = np.rint((along - lap * length) / spacing).astype(np.intp)
        near = sample[:, None] + np.arange(-BACK, AHEAD + 1)
        last = (self.counts - 1)[self.index][:, None]
        wrapped = np.where(closed[:, None], near % last, np.clip(near, 0, last))
        at = self.starts[self.index][:, None] + wrapped
        dx, dy = x[:, None] - self._x[at], y[:, None] - self._y[at]
        best = np.argmin(dx * dx + dy * dy, axis=1)
        row = np.arange(len(x))
        spot, dx, dy = at[row, best], dx[row, best], dy[row, best]
        psi = self._heading[spot]
        forward = dy * np.cos(psi) - dx * np.sin(psi)
        left = -dx * np.cos(psi) - dy * np.sin(psi)
        # The sample's circle of curvature carries the place beyond the sample.
        bend = np.clip(self._curvature[spot] * left, -0.9, 0.9)
        ahead = np.clip(forward / (1.0 - bend), -spacing, spacing)
        chosen = np.where(closed, near[row, best], np.clip(near[row, best], 0, last[:, 0]))
        found = lap * length + chosen * spacing + ahead
        found = np.where(closed, found, np.clip(found, 0.0, length))
        moved = found - (lap * length + chosen * spacing)
        curvature = self.curvature(found)
        psi = psi + moved * self._curvature[spot]
        left = left + 0.5 * moved * moved * self._curvature[spot]
        error = np.asarray(wrap_angle(heading - psi))
        return Place(found, left, error, curvature)

    def _of(self, per_path: np.ndarray, along: np.ndarray) -> np.ndarray:
        chosen = per_path[self.index]
        return np.asarray(chosen if along.ndim == 1 else chosen[:, None])

    def _find(self, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the sample below each distance, and the share of the next."""
        length, closed = self._of(self.lengths, along), self._of(self.closed, along)
        inside = np.where(closed, along % length, np.clip(along, 0.0, length))
        at = inside / self._of(self.spacings, along)
        below = np.minimum(at.astype(np.intp), self._of(self.counts, along) - 2)
        return self._of(self.starts, along) + below, at - below
