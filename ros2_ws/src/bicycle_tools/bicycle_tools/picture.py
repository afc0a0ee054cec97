"""Picture of a ride: the track with its goals, and lean, steering and commands over time."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bicycle_common.plot_style import INK
from bicycle_tools.drawing import (
    LEAN,
    REACHED,
    SHIFT,
    STEER,
    STYLE,
    TORQUE,
    Floats,
    drawable,
    ride_time,
)
from bicycle_tools.ride_log import RideLog
from bicycle_tools.summary import RideSummary, summarise
from bicycle_tools.track import draw_track


def draw_ride(log: RideLog, path: Path) -> None:
    """Draw a ride.

    Args:
        log: the ride.
        path: PNG to write.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(12.0, 6.8), layout="constrained")
        grid = figure.add_gridspec(4, 2, width_ratios=(1.15, 1.0))
        draw_track(figure, figure.add_subplot(grid[:, 0]), log)
        time = ride_time(log)
        strips = [figure.add_subplot(grid[0, 1])]
        strips += [figure.add_subplot(grid[row, 1], sharex=strips[0]) for row in (1, 2, 3)]
        _strips(strips, log, time)
        figure.suptitle(headline(summarise(log)), fontsize=12, fontweight="bold")
        figure.savefig(path, dpi=150)


def _strips(strips: list[Axes], log: RideLog, time: Floats) -> None:
    """Draw lean, steering, commands and distance over time."""
    lean, steer, command, distance = strips
    states = log.states
    _line(lean, time, np.degrees(states["lean_angle"]), LEAN, "lean (°)")
    _line(steer, time, np.degrees(states["steer_angle"]), STEER, "steering (°)")
    torque, shift = (drawable(states[f"applied.{name}"]) for name in ("torque", "displacement"))
    if np.isfinite(torque).any():
        _line(command, time, torque, TORQUE, "torque (N m)")
        if np.nanmax(np.abs(shift)) > 0:
            other = command.twinx()
            other.grid(visible=False)
            _line(other, time, 100.0 * shift, SHIFT, "displacement (cm)")
    _progress(distance, log, time)
    distance.set_xlabel("time (s)")
    for axes in strips[:-1]:
        axes.tick_params(labelbottom=False)
    for axes in strips:
        axes.margins(x=0.0)
        _mark_goals(axes, log, time)


def _progress(axes: Axes, log: RideLog, time: Floats) -> None:
    """Draw the distance to the goal, or from the path where only a path was followed."""
    statuses = log.path_statuses
    if np.isfinite(drawable(log.states["goal_distance"])).any() or not len(
        statuses.get("path_id", ())
    ):
        _line(axes, time, log.states["goal_distance"], INK, "distance to\ngoal (m)")
        axes.set_ylim(bottom=0.0)
        return
    # Simulated time begins anew at a reset; the recorder's does not.
    when = np.interp(statuses["log_time"], log.states["log_time"], time)
    _line(axes, when, statuses["cross_track"], INK, "off the\npath (m)")


def _line(axes: Axes, time: Floats, values: Floats, colour: str, label: str) -> None:
    axes.plot(time, drawable(values), color=colour, linewidth=0.9)
    axes.set_ylabel(label, color=colour)


def _mark_goals(axes: Axes, log: RideLog, time: Floats) -> None:
    """Draw a thin vertical line at every change of the goal."""
    place = np.stack([log.states["goal.x"], log.states["goal.y"]], axis=1)
    changed = (np.diff(place, axis=0) != 0).any(axis=1) & np.isfinite(place[1:]).all(axis=1)
    for row in np.flatnonzero(changed):
        axes.axvline(time[row + 1], color=REACHED, linewidth=0.7, alpha=0.5, zorder=0)


def headline(summary: RideSummary) -> str:
    """Return the main numbers in one line."""
    falls = {0: "no fall", 1: "1 fall"}.get(summary.falls, f"{summary.falls} falls")
    parts = [f"{summary.reached} of {summary.goals} goals"] if summary.goals else []
    parts += [path.verdict for path in summary.paths]
    known = np.isfinite(summary.path_length)
    length = f"{summary.path_length:.0f} m" if known else "an unknown path"
    parts += [falls, f"{length} in {summary.ridden_time:.0f} s"]
    if np.isfinite(summary.path_ratio):
        parts.append(f"path {summary.path_ratio:.2f} × straight line")
    return "   ·   ".join(parts)
