"""Goals of a ride: random goals, and files of waypoints."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np

from bicycle_common import yaml_text
from bicycle_common.types import Point2D

NEAREST = 10.0
"""Least distance between consecutive goals (m); a tight circle at 10 km/h has 1.4 m radius."""


def random_goals(
    count: int, field: float, start: Point2D, rng: np.random.Generator, nearest: float = NEAREST
) -> list[Point2D]:
    """Draw goals uniformly from a square around the start, each at a distance from the last.

    Args:
        count: number of goals.
        field: side of the square, m.
        start: m, its centre, which the first goal keeps away from too.
        rng: generator; the same state gives the same goals.
        nearest: m, least distance between a goal and the one before.

    Raises:
        ValueError: if the square is too small for that distance, or a number is out of range.
    """
    if count < 1:
        raise ValueError(f"a ride needs at least one goal, not {count}")
    if not (math.isfinite(field) and field >= 2 * nearest):
        raise ValueError(f"the field must be at least {2 * nearest:g} m wide, not {field:g}")
    goals: list[Point2D] = []
    before = start
    while len(goals) < count:
        x, y = (float(value) for value in rng.uniform(-field / 2, field / 2, size=2))
        goal = (round(start[0] + x, 2), round(start[1] + y, 2))
        if math.dist(goal, before) >= nearest:
            goals.append(goal)
            before = goal
    return goals


def read_waypoints(path: Path) -> list[Point2D]:
    """Return the points of a file, in order.

    Args:
        path: YAML with a list of `[x, y]` or `{x: …, y: …}`, or under the key `waypoints`
            such a list; or CSV with one `x,y` a line, with or without a line of names.

    Raises:
        ValueError: with one line that names the file, the place and the remedy.
    """
    if path.suffix not in (".yaml", ".yml", ".csv"):
        raise ValueError(f"{path} is neither .yaml nor .csv: name a file of waypoints")
    try:
        text = yaml_text.read_text(path)
    except OSError as error:
        raise ValueError(f"cannot read {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ValueError(f"{path} is not text: name a file of waypoints") from None
    except yaml_text.YAMLError as error:
        raise ValueError(f"cannot read {path}: {error}; name a file of waypoints") from None
    items = _csv_rows(text) if path.suffix == ".csv" else _yaml_items(path, text)
    points = [_point(path, where, item) for where, item in items]
    if not points:
        raise ValueError(f"{path} holds no waypoint: write one x, y per goal")
    return points


def _csv_rows(text: str) -> list[tuple[str, Any]]:
    rows = [
        (f"line {number}", [cell.strip() for cell in row])
        for number, row in enumerate(csv.reader(text.splitlines()), 1)
        if row and not row[0].lstrip().startswith("#")
    ]
    if rows and [cell.lower() for cell in rows[0][1][:2]] == ["x", "y"]:
        rows = rows[1:]
    return rows


def _yaml_items(path: Path, text: str) -> list[tuple[str, Any]]:
    try:
        data = yaml_text.load(text)
    except yaml_text.YAMLError as error:
        raise ValueError(f"{path} is not YAML: {' '.join(str(error).split())}") from None
    if isinstance(data, dict):
        data = data.get("waypoints")
    if not isinstance(data, list):
        raise ValueError(f"{path} must be a list of [x, y], or have one under 'waypoints'")
    return [(f"waypoint {number}", item) for number, item in enumerate(data, 1)]


def _point(path: Path, where: str, item: Any) -> Point2D:
    """Return one waypoint as numbers."""
    pair: Any = [item.get("x"), item.get("y")] if isinstance(item, dict) else item
    try:
        x, y = (float(value) for value in pair)
    except (TypeError, ValueError):
        raise ValueError(f"{path}, {where}: {item!r} is not a point: write x, y") from None
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ValueError(f"{path}, {where}: ({x}, {y}) is not finite: write metres")
    return x, y
