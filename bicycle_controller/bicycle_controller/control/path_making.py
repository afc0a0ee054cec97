"""Paths from points: corners are rounded as a bicycle can ride them, or the path is refused."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bicycle_common.types import Point2D
from bicycle_common.validation import require
from bicycle_controller.control.path import LONGEST, Path, sampled

TIGHTEST = 2.5
"""Radius of the sharpest turn that a path may contain if the bicycle is unknown, m."""
SAME = 0.01
"""Distance below which two points are one, m."""
WORTH_TELLING = 0.3
"""Distance from which on a rounded corner is reported, m."""
STEP = 0.02
"""m between the samples of a rounded corner."""
CURVE = 0.1
"""Largest cut of a corner that has all its room at which the points count as a curve, m."""
MOST_TOLD = 5
"""Largest number of rounded corners that are reported one by one."""


class PathRefusedError(ValueError):
    """Reason why a bicycle cannot ride a path, with the number, in one line."""


@dataclass(frozen=True)
class Rounding:
    """Rules by which corners become turns.

    Raises:
        ValueError: unless all are above zero and `tightest` is the smallest radius.
    """

    tightest: float = TIGHTEST
    """m, radius of the sharpest turn that the bicycle rides."""
    widest: float = 6.0
    """m, radius that corners get where the path leaves room."""
    cut: float = 1.5
    """m, largest distance that a corner is cut by for a radius above the tightest."""
    slack: float = 0.25
    """m, by which points may be left out where they are too close together for any turn."""
    refuse: bool = False
    """True to refuse every corner instead of rounding it."""

    def __post_init__(self) -> None:
        numbers = (self.tightest, self.widest, self.cut, self.slack)
        require(all(math.isfinite(n) and n > 0 for n in numbers), "roundings must be above zero")
        require(self.tightest <= self.widest, "the tightest radius is above the widest")


def path_through(
    points: Sequence[Point2D],
    closed: bool | None = None,
    rounding: Rounding | None = None,
    noise: float = 0.0,
) -> Path:
    """Return the path along the points, with rounded corners.

    Args:
        points: m, in order.
        closed: True for a loop; None takes it for one if it ends within 0.5 m of its start, and
            in about the direction in which it begins.
        rounding: how corners become turns.
        noise: m, standard deviation of the points, which the path is smoothed by; zero believes
            them.

    Raises:
        PathRefusedError: on a corner that the bicycle cannot ride, with its number, or on points
            that make no path.
    """
    rounding = rounding or Rounding()
    corners = _distinct(points)
    if len(corners) < 2:
        raise PathRefusedError("a path needs two different points or more")
    chords = np.hypot(*np.diff(np.array(corners), axis=0).T).sum()
    if chords > 1.1 * LONGEST:  # told before corners are rounded; that shortens it a little
        raise PathRefusedError(f"a path of {chords:.7g} m is longer than {LONGEST:g} m")
    if closed is None:
        closed = _comes_round(corners)
    if closed:
        repeated = math.dist(corners[0], corners[-1]) < (0.5 if len(corners) > 3 else SAME)
        corners = corners[:-1] if repeated else corners
        if len(corners) < 3:
            raise PathRefusedError("a loop needs three different points or more")
    if noise > 0.0:
        return _smoothed(np.array(corners), closed, noise, rounding)
    try:
        return _rounded(np.array(corners), closed, rounding)
    except PathRefusedError:
        fewer = _simplified(np.array(corners), rounding.slack)
        if len(fewer) == len(corners) or (closed and len(fewer) < 3):
            raise
        return _rounded(fewer, closed, rounding)


def check(path: Path, tightest: float, share: float = 0.98) -> None:
    """Refuse a path that turns more sharply than a bicycle can.

    Args:
        path: a path.
        tightest: m, radius of the sharpest turn that the bicycle rides.
        share: of that radius which still passes: samples make a curvature a little uneven.

    Raises:
        PathRefusedError: names the place and both radii.
    """
    worst = int(np.abs(path.curvature).argmax())
    radius = 1.0 / max(path.sharpest, 1e-9)
    if radius >= share * tightest:
        return
    raise PathRefusedError(
        f"the path turns with a radius of {radius:.2f} m at ({path.x[worst]:.1f}, "
        f"{path.y[worst]:.1f}), this bicycle with {tightest:.2f} m at least: widen it there"
    )


def _distinct(points: Sequence[Point2D]) -> list[Point2D]:
    kept: list[Point2D] = []
    for point in points:
        if not all(math.isfinite(value) for value in point):
            raise PathRefusedError(f"point {len(kept) + 1} of the path is not finite: give metres")
        if not kept or math.dist(point, kept[-1]) > SAME:
            kept.append((float(point[0]), float(point[1])))
    return kept


def _comes_round(points: Sequence[Point2D]) -> bool:
    """Return True if a path ends where and as it began."""
    if len(points) < 4 or math.dist(points[0], points[-1]) > 0.5:
        return False
    ends = np.array([points[0], points[1], points[-2], points[-1]])
    first, last = ends[1] - ends[0], ends[3] - ends[2]
    cosine = float(first @ last) / (np.linalg.norm(first) * np.linalg.norm(last))
    return bool(cosine > -0.1)


def _rounded(points: np.ndarray, closed: bool, rounding: Rounding) -> Path:
    """Replace every corner by an arc that touches both legs."""
    count = len(points)
    legs = np.roll(points, -1, axis=0) - points
    if not closed:
        legs = legs[:-1]
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    toward = legs / lengths[:, None]
    pieces: list[np.ndarray] = [] if closed else [points[:1]]
    roundings: list[tuple[float, str]] = []
    for at in range(0 if closed else 1, count if closed else count - 1):
        before, after = (at - 1) % len(legs), at % len(legs)
        room = 0.5 * min(lengths[before], lengths[after])
        if not closed:  # a first or last leg need not share its length with another corner
            room = min(
                lengths[before] * (1.0 if at == 1 else 0.5),
                lengths[after] * (1.0 if at == count - 2 else 0.5),
            )
        piece, cut, text = _corner(points[at], toward[before], toward[after], room, rounding)
        pieces.append(piece)
        if cut >= WORTH_TELLING:
            roundings.append((cut, text))
    if not closed:
        pieces.append(points[-1:])
    dense = np.concatenate(pieces)
    if closed:  # it begins in the middle of the first leg, where it is straight
        middle = 0.5 * (points[:1] + points[1:2])
        first = len(pieces[0])
        dense = np.concatenate([middle, dense[first:], dense[:first], middle])
    return sampled(dense[:, 0], dense[:, 1], closed, _rounding_notes(roundings))


def _rounding_notes(corners: list[tuple[float, str]]) -> list[str]:
    lines = [text for _, text in corners[:MOST_TOLD]]
    more = corners[MOST_TOLD:]
    if more:
        lines.append(f"{len(more)} more are rounded, cut by up to {max(c for c, _ in more):.2f} m")
    return lines


def _corner(
    point: np.ndarray, before: np.ndarray, after: np.ndarray, room: float, rounding: Rounding
) -> tuple[np.ndarray, float, str]:
    """Return the samples of one corner's arc, by how much it cuts the corner, and the text.

    Raises:
        PathRefusedError: if the legs leave no room for the tightest turn.
    """
    cross = float(before[0] * after[1] - before[1] * after[0])
    turn = math.atan2(cross, float(before @ after))
    size = abs(turn)
    where = f"the corner of {math.degrees(size):.0f}° at ({point[0]:.1f}, {point[1]:.1f})"
    if size < 1e-6:
        return point[None], 0.0, ""
    half = math.tan(0.5 * size) if size < math.pi - 1e-6 else math.inf
    most = room / half
    if most < rounding.tightest:
        raise PathRefusedError(
            f"{where} leaves room for a radius of {most:.2f} m, this bicycle turns with "
            f"{rounding.tightest:.2f} m at least: move the points apart or smooth the path"
        )
    beyond = 1.0 / math.cos(0.5 * size) - 1.0
    wanted = min(rounding.widest, most)
    # Small turns of many points are a curve: it keeps all the room, however wide that is.
    if beyond * most <= CURVE:
        wanted = most
    else:
        wanted = min(wanted, max(rounding.tightest, rounding.cut / beyond))
    cut = beyond * wanted
    if rounding.refuse and cut >= WORTH_TELLING:
        raise PathRefusedError(f"{where} would be cut by {cut:.2f} m, and rounding is off")
    side = math.copysign(1.0, turn)
    start = point - before * wanted * half
    left = np.array([-before[1], before[0]])
    centre = start + side * wanted * left
    angles = np.linspace(0.0, size, max(3, math.ceil(size * wanted / STEP) + 1))
    samples = (
        centre
        - side * wanted * np.cos(angles)[:, None] * left
        + wanted * np.sin(angles)[:, None] * before
    )
    return samples, cut, f"{where} is rounded with {wanted:.2f} m, cut by {cut:.2f} m"


def _simplified(points: np.ndarray, slack: float) -> np.ndarray:
    """Return the points without those within `slack` of the pieces between the others.

    Source: D. H. Douglas and T. K. Peucker, Cartographica 10 (1973) 112.
    """
    keep = np.zeros(len(points), dtype=bool)
    keep[[0, -1]] = True
    stack = [(0, len(points) - 1)]
    while stack:
        first, last = stack.pop()
        if last - first < 2:
            continue
        line = points[last] - points[first]
        offset = points[first + 1 : last] - points[first]
        # Of the piece, not of the line through it: a path that turns back goes beyond its ends.
        share = np.clip(offset @ line / max(float(line @ line), SAME**2), 0.0, 1.0)
        far = np.hypot(*(offset - share[:, None] * line).T)
        worst = int(far.argmax())
        if far[worst] > slack:
            split = first + 1 + worst
            keep[split] = True
            stack += [(first, split), (split, last)]
    return points[keep]


def _smoothed(points: np.ndarray, closed: bool, noise: float, rounding: Rounding) -> Path:
    """Return a smoothing spline through noisy points.

    Raises:
        PathRefusedError: if it turns too sharply even when smoothed by eight times the noise.
    """
    from scipy.interpolate import splev, splprep

    if len(points) < 5:
        raise PathRefusedError("a noisy path needs five points or more")
    if closed:
        points = np.concatenate([points, points[:1]])
    length = float(np.hypot(*np.diff(points, axis=0).T).sum())
    refused: PathRefusedError | None = None
    for factor in (1.0, 2.0, 4.0, 8.0):
        weight = len(points) * (factor * noise) ** 2
        curve, _ = splprep(points.T, s=weight, per=closed, k=3)
        x, y = splev(np.linspace(0.0, 1.0, max(50, round(length / STEP))), curve)
        away = max(float(np.hypot(*(points - _nearest(points, x, y)).T).max()), 0.0)
        note = f"smoothed: the farthest point is {away:.2f} m off the path"
        path = sampled(np.asarray(x), np.asarray(y), closed, [note])
        try:
            check(path, rounding.tightest)
            return path
        except PathRefusedError as error:
            refused = error
    assert refused is not None
    raise refused


def _nearest(points: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the point of a dense curve that is nearest to each point, (K, 2)."""
    from scipy.spatial import cKDTree

    curve = np.column_stack([x, y])
    return np.asarray(curve[cKDTree(curve).query(points)[1]])
