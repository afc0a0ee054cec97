"""Paths that a bag's bicycle followed, with the time of each, for the page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bicycle_cockpit.marks import Ridden, rows_of
from bicycle_cockpit.samples import plain
from bicycle_controller.control.guide import PathEnd

MOST_PATHS = 200
MOST_POINTS = 1_000
"""Largest number of points of a path on a page; longer ones are thinned."""

Points = list[list[float | None]]


def thinned(points: Sequence[Sequence[float]]) -> Points:
    """Return a path's points for JSON, m, at most MOST_POINTS."""
    stride = -(-len(points) // MOST_POINTS) or 1
    kept = [*points[::stride]]
    if len(points) and (len(points) - 1) % stride:
        kept[-1] = points[-1]  # it ends where it ends
    return [[plain(float(x)), plain(float(y))] for x, y in kept]


def followed_paths(ridden: Ridden) -> list[dict[str, Any]]:
    """Return `from` and `to` (s, None for the ride's end) and `points` (m) of the followed paths.

    A path is published once, and its status says how long it is followed.
    """
    found: list[dict[str, Any]] = []
    newest, shown = -1, False
    for row, path, status in _events(ridden):
        now = round(float(ridden.time[row]), 3)
        if status is None:
            newest = path
        elif status == PathEnd.ACTIVE and not shown and newest >= 0:
            points = thinned(ridden.ride.paths[newest].tolist())
            found.append({"from": now, "to": None, "points": points})
            shown = True
        elif status not in (PathEnd.ACTIVE, PathEnd.REJECTED) and shown:
            found[-1]["to"] = now
            shown = False
    return found[:MOST_PATHS]


def _events(ridden: Ridden) -> Iterator[tuple[int, int, int | None]]:
    """Yield row, number of a new path, and status; the status is None for a new path."""
    ride = ridden.ride
    orders: list[NDArray[np.int64]] = [ride.path_orders]
    kinds: list[tuple[int, int | None]] = [(number, None) for number in range(len(ride.paths))]
    if len(ride.path_statuses.get("status", ())):
        orders.append(ride.path_statuses["recorded_order"])
        kinds += [(-1, int(status)) for status in ride.path_statuses["status"]]
    places = np.concatenate(orders)
    rows = rows_of(ridden, {"recorded_order": places})
    for at in np.argsort(places, kind="stable").tolist():
        yield rows[at], *kinds[at]
