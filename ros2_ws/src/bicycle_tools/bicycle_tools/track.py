"""Track of a ride over the plane, with its goals, starts and falls."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from bicycle_common.plot_style import FAINT, INK
from bicycle_controller.control.goals import Status
from bicycle_tools.drawing import FAILED, REACHED, Floats, drawable, ride_time
from bicycle_tools.outcomes import GoalOutcome, outcomes
from bicycle_tools.ride_log import RideLog

GOAL_RADIUS = 1.0
"""Radius of a goal around the rear contact, m (errata row 26)."""
MOST_POINTS = 8000
"""Largest number of points of the track; more cannot be seen, and slow down vector graphics."""
MOST_COLOURS = 250
_COLOURS = {Status.REACHED: REACHED, Status.ACTIVE: FAINT, Status.QUEUED: FAINT}


def draw_track(figure: Figure | SubFigure, axes: Axes, log: RideLog) -> None:
    """Draw the rear contact's track, coloured by speed or time, with its events.

    Args:
        figure: receives the colour scale.
        axes: empty ones.
        log: the ride; without states only its goals are drawn.
    """
    for points in log.paths:
        points = drawable(points)
        axes.plot(points[:, 0], points[:, 1], color=FAINT, linewidth=5.0, alpha=0.35, zorder=1)
    for number, goal in enumerate(outcomes(log.statuses), 1):
        _goal(axes, number, goal)
    if len(log.segment):
        _way(figure, axes, log)
        _start_and_falls(axes, log)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)
    axes.autoscale_view()
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")


def _way(figure: Figure | SubFigure, axes: Axes, log: RideLog) -> None:
    values, label = _colouring(log)
    points = _places(log)
    pieces, colours = [], []
    for rows in _pieces(log.segment, points):
        pieces.append(points[rows])
        colours.append(values[rows[0]])
    line = LineCollection(
        pieces, cmap=_colours(), norm=_norm(values), linewidths=2.2, capstyle="round", zorder=3
    )
    line.set_array(np.array(colours))
    axes.add_collection(line)
    scale = axes.inset_axes((0.68, 1.015, 0.32, 0.014))
    bar = figure.colorbar(line, cax=scale, orientation="horizontal", ticklocation="top")
    bar.outline.set_visible(False)
    axes.text(0.665, 1.022, label, transform=axes.transAxes, ha="right", va="center", color=FAINT)


def _places(log: RideLog) -> Floats:
    """Return the places of the rear contact, m, (n, 2); NaN where they cannot be drawn."""
    return drawable(np.stack([log.states["rear_contact.x"], log.states["rear_contact.y"]], axis=1))


def _pieces(segment: NDArray[np.intp], points: Floats) -> list[NDArray[np.intp]]:
    """Return the rows of short unbroken stretches of one colour, which touch at their ends."""
    finite = np.isfinite(points).all(axis=1)
    kept = np.flatnonzero(finite)[:: max(1, len(points) // MOST_POINTS)]
    length = max(2, -(-len(kept) // MOST_COLOURS))
    pieces = []
    for begin in range(0, len(kept) - 1, length):
        rows = kept[begin : begin + length + 1]
        breaks = np.flatnonzero(np.diff(segment[rows])) + 1
        pieces += [part for part in np.split(rows, breaks) if len(part) > 1]
    return pieces


def _colours() -> Colormap:
    """Return Viridis without its ends, which are invisible on white or on black."""
    steps = mpl.colormaps["viridis"](np.linspace(0.12, 0.9, 64))
    return LinearSegmentedColormap.from_list("track", [tuple(step) for step in steps])


def _norm(values: Floats) -> Normalize:
    return Normalize(float(np.nanmin(values)), float(np.nanmax(values)))


def _colouring(log: RideLog) -> tuple[Floats, str]:
    """Return the values that colour the track: the speed if it changes, else the time."""
    speed = drawable(np.asarray(log.states["speed"], dtype=np.float64))
    if np.isfinite(speed).all() and float(np.ptp(speed)) > 0.05:
        return speed, "speed (m/s)"
    return ride_time(log), "time (s)"


def _goal(axes: Axes, number: int, goal: GoalOutcome) -> None:
    """Draw one goal with its true radius."""
    if not np.isfinite(drawable(np.array(goal.position))).all():
        return
    colour = _COLOURS.get(goal.status, FAILED)
    axes.add_patch(Circle(goal.position, GOAL_RADIUS, facecolor=colour, alpha=0.18, zorder=2))
    axes.add_patch(Circle(goal.position, GOAL_RADIUS, fill=False, edgecolor=colour, zorder=2))
    axes.annotate(
        str(number),
        goal.position,
        xytext=(7, 7),
        textcoords="offset points",
        color=colour,
        fontweight="bold",
        zorder=5,
    )


def _start_and_falls(axes: Axes, log: RideLog) -> None:
    """Draw a triangle in the direction of each start, a cross at each fall."""
    states, places = log.states, _places(log)
    for row in np.flatnonzero(np.diff(log.segment, prepend=-1)):
        turn = np.degrees(np.nan_to_num(drawable(states["heading"][row]))) - 90.0
        axes.plot(*places[row], marker=(3, 0, turn), markersize=13, color=INK, zorder=4)
    fell = np.flatnonzero(np.diff(states["fallen"].astype(int), prepend=0) > 0)
    axes.plot(*places[fell].T, "X", markersize=11, color=FAILED, markeredgecolor="white", zorder=6)
