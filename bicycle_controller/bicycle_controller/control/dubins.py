"""Shortest paths of a bicycle that turns with one radius at least (Dubins 1957).

Source of the six words' lengths: A. M. Shkel and V. Lumelsky, Robotics and Autonomous Systems 34
(2001) 179, eqs. 11 to 20. Angles are yaw, counter-clockwise from +x.
"""

from __future__ import annotations

import math

import numpy as np

WORDS = ("LSL", "RSR", "LSR", "RSL", "RLR", "LRL")
STEP = 0.02
"""m between the points of a path."""

Pose2D = tuple[float, float, float]
"""x and y, m, and yaw, rad."""


def shortest(start: Pose2D, end: Pose2D, radius: float) -> list[tuple[str, float]]:
    """Return the segments of the shortest path: L, S or R and its length, m."""
    found = [(sum(parts), word, parts) for word, parts in _words(start, end, radius)]
    _, word, parts = min(found, key=lambda item: item[0])
    return [(kind, part * radius) for kind, part in zip(word, parts, strict=True) if part > 1e-9]


def points(
    start: Pose2D, segments: list[tuple[str, float]], radius: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return dense points along segments, (K,) m each."""
    xs, ys = [np.array([start[0]])], [np.array([start[1]])]
    x, y, yaw = start
    for kind, length in segments:
        along = np.linspace(0.0, length, max(2, math.ceil(length / STEP) + 1))[1:]
        bend = {"L": 1.0, "S": 0.0, "R": -1.0}[kind] / radius
        if bend == 0.0:
            forward, left = along, 0.0 * along
        else:
            forward = np.sin(bend * along) / bend
            left = (1.0 - np.cos(bend * along)) / bend
        c, s = math.cos(yaw), math.sin(yaw)
        xs.append(x + c * forward - s * left)
        ys.append(y + s * forward + c * left)
        x, y, yaw = float(xs[-1][-1]), float(ys[-1][-1]), yaw + bend * length
    return np.concatenate(xs), np.concatenate(ys)


def _words(start: Pose2D, end: Pose2D, radius: float) -> list[tuple[str, tuple[float, ...]]]:
    """Return the words that exist and their parts in units of the radius."""
    dx, dy = (end[0] - start[0]) / radius, (end[1] - start[1]) / radius
    d, line = math.hypot(dx, dy), math.atan2(dy, dx)
    a, b = _turn(start[2] - line), _turn(end[2] - line)
    sa, sb, ca, cb, cab = math.sin(a), math.sin(b), math.cos(a), math.cos(b), math.cos(a - b)
    found: list[tuple[str, tuple[float, ...]]] = []
    square = 2.0 + d * d - 2.0 * cab + 2.0 * d * (sa - sb)
    if square >= 0.0:
        way = math.atan2(cb - ca, d + sa - sb)
        found.append(("LSL", (_turn(way - a), math.sqrt(square), _turn(b - way))))
    square = 2.0 + d * d - 2.0 * cab + 2.0 * d * (sb - sa)
    if square >= 0.0:
        way = math.atan2(ca - cb, d - sa + sb)
        found.append(("RSR", (_turn(a - way), math.sqrt(square), _turn(way - b))))
    square = -2.0 + d * d + 2.0 * cab + 2.0 * d * (sa + sb)
    if square >= 0.0:
        p = math.sqrt(square)
        way = math.atan2(-ca - cb, d + sa + sb) - math.atan2(-2.0, p)
        found.append(("LSR", (_turn(way - a), p, _turn(way - b))))
    square = -2.0 + d * d + 2.0 * cab - 2.0 * d * (sa + sb)
    if square >= 0.0:
        p = math.sqrt(square)
        way = math.atan2(ca + cb, d - sa - sb) - math.atan2(2.0, p)
        found.append(("RSL", (_turn(a - way), p, _turn(b - way))))
    cosine = (6.0 - d * d + 2.0 * cab + 2.0 * d * (sa - sb)) / 8.0
    if abs(cosine) <= 1.0:
        p = _turn(2.0 * math.pi - math.acos(cosine))
        t = _turn(a - math.atan2(ca - cb, d - sa + sb) + 0.5 * p)
        found.append(("RLR", (t, p, _turn(a - b - t + p))))
    cosine = (6.0 - d * d + 2.0 * cab + 2.0 * d * (sb - sa)) / 8.0
    if abs(cosine) <= 1.0:
        p = _turn(2.0 * math.pi - math.acos(cosine))
        t = _turn(-a - math.atan2(ca - cb, d + sa - sb) + 0.5 * p)
        found.append(("LRL", (t, p, _turn(b - a - t + p))))
    return found


def _turn(angle: float) -> float:
    """Return the same direction in [0, 2 pi), rad; a full turn, up to rounding, becomes 0."""
    inside = angle % (2.0 * math.pi)
    return 0.0 if inside > 2.0 * math.pi - 1e-9 else inside
