"""A ride as a picture: the track with its goals, and what lean, steering and commands did."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from bicycle_bringup.outcomes import Outcome, outcomes
from bicycle_bringup.ride_log import Columns, RideLog
from bicycle_bringup.summary import RideSummary, summarise
from bicycle_controller.goals import Status

GOAL_RADIUS = 1.0
"""m around the rear contact (errata row 26)."""

INK, FAINT, GRID = "#1f2933", "#7b8794", "#e4e7eb"
REACHED, FAILED, LEAN, STEER, TORQUE, SHIFT = (
    "#0b8457",
    "#c0392b",
    "#3a5ba0",
    "#d1495b",
    "#5f4b8b",
    "#e08e0b",
)
STYLE: Any = {
    "font.family": "sans-serif",
    "font.size": 9,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": GRID,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
}

Floats = NDArray[np.float64]


def draw_ride(log: RideLog, path: Path) -> None:
    """Draw a ride.

    Args:
        log: the ride.
        path: PNG to write.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(12.0, 6.8), layout="constrained")
        grid = figure.add_gridspec(4, 2, width_ratios=(1.15, 1.0))
        _track(figure, figure.add_subplot(grid[:, 0]), log)
        time = ride_time(log)
        strips = [figure.add_subplot(grid[0, 1])]
        strips += [figure.add_subplot(grid[row, 1], sharex=strips[0]) for row in (1, 2, 3)]
        _strips(strips, log, time)
        _title(figure, summarise(log))
        figure.savefig(path, dpi=150)


def ride_time(log: RideLog) -> Floats:
    """s of simulated time since the start, (n,) for the states, going on through resets."""
    elapsed = np.diff(log.states["header.stamp"])
    elapsed[(np.diff(log.segment) != 0) | (elapsed < 0)] = 0.0
    return np.concatenate([[0.0], np.cumsum(elapsed)])


def _track(figure: Figure, axes: Axes, log: RideLog) -> None:
    """The rear contact's way over the plane."""
    x, y = log.states["rear_contact.x"], log.states["rear_contact.y"]
    values, label, colours = _colouring(log)
    points = np.stack([x, y], axis=1)
    legs = np.stack([points[:-1], points[1:]], axis=1)[np.diff(log.segment) == 0]
    line = LineCollection(list(legs), cmap=colours, linewidths=2.2, capstyle="round", zorder=3)
    line.set_array(values[:-1][np.diff(log.segment) == 0])
    axes.add_collection(line)
    for number, goal in enumerate(outcomes(log.statuses), 1):
        _goal(axes, number, goal)
    _start_and_falls(axes, log)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)
    axes.autoscale_view()
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    scale = axes.inset_axes((0.68, 1.015, 0.32, 0.014))
    bar = figure.colorbar(line, cax=scale, orientation="horizontal", ticklocation="top")
    bar.outline.set_visible(False)
    axes.text(0.665, 1.022, label, transform=axes.transAxes, ha="right", va="center", color=FAINT)


def _colouring(log: RideLog) -> tuple[Floats, str, str]:
    """What colours the track: the speed where it changes, else the time."""
    speed = np.asarray(log.states["speed"], dtype=np.float64)
    if float(np.ptp(speed)) > 0.05:
        return speed, "speed (m/s)", "viridis"
    return ride_time(log), "time (s)", "viridis"


def _goal(axes: Axes, number: int, goal: Outcome) -> None:
    """One goal with its true radius."""
    colour = REACHED if goal.status is Status.REACHED else FAILED
    face = (*mpl.colors.to_rgb(colour), 0.18)
    axes.add_patch(Circle(goal.position, GOAL_RADIUS, facecolor=face, edgecolor=colour, zorder=2))
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
    """A triangle in the direction of each start, a cross where the bicycle fell."""
    states = log.states
    begins = np.flatnonzero(np.diff(log.segment, prepend=-1))
    for row in begins:
        turn = np.degrees(states["heading"][row]) - 90.0
        place = (states["rear_contact.x"][row], states["rear_contact.y"][row])
        axes.plot(*place, marker=(3, 0, turn), markersize=13, color=INK, zorder=4)
    fell = np.flatnonzero(np.diff(states["fallen"].astype(int), prepend=0) > 0)
    where = (states["rear_contact.x"][fell], states["rear_contact.y"][fell])
    axes.plot(*where, "X", markersize=11, color=FAILED, markeredgecolor="white", zorder=6)


def _strips(strips: list[Axes], log: RideLog, time: Floats) -> None:
    """Lean, steering, commands and distance over time."""
    lean, steer, command, distance = strips
    states = log.states
    _line(lean, time, np.degrees(states["lean_angle"]), LEAN, "lean (°)")
    _line(steer, time, np.degrees(states["steer_angle"]), STEER, "steering (°)")
    applied = _applied(log)
    if applied is not None:
        _line(command, time, applied[0], TORQUE, "torque (N m)")
        if np.nanmax(np.abs(applied[1])) > 0:
            other = command.twinx()
            other.grid(visible=False)
            _line(other, time, 100.0 * applied[1], SHIFT, "displacement (cm)")
    _line(distance, time, states["goal_distance"], INK, "goal in (m)")
    distance.set_ylim(bottom=0.0)
    distance.set_xlabel("time (s)")
    for axes in strips[:-1]:
        axes.tick_params(labelbottom=False)
    for axes in strips:
        axes.margins(x=0.0)
        _mark_goals(axes, log, time)


def _line(axes: Axes, time: Floats, values: Floats, colour: str, label: str) -> None:
    axes.plot(time, values, color=colour, linewidth=0.9)
    axes.set_ylabel(label, color=colour)


def _mark_goals(axes: Axes, log: RideLog, time: Floats) -> None:
    """A thin upright line wherever the goal changes."""
    place = np.stack([log.states["goal.x"], log.states["goal.y"]], axis=1)
    changed = (np.diff(place, axis=0) != 0).any(axis=1) & np.isfinite(place[1:]).all(axis=1)
    for row in np.flatnonzero(changed):
        axes.axvline(time[row + 1], color=REACHED, linewidth=0.7, alpha=0.5, zorder=0)


def _applied(log: RideLog) -> tuple[Floats, Floats] | None:
    """Torque (N m) and displacement (m) that led to each state; NaN where there was no command."""
    commands: Columns = log.commands
    if not len(commands.get("step", ())):
        return None
    keys = {
        (int(episode), int(step)): row
        for row, (episode, step) in enumerate(
            zip(commands["episode"], commands["step"], strict=True)
        )
    }
    states = log.states
    rows = np.array(
        [
            keys.get((int(episode), int(step)), -1)
            for episode, step in zip(states["episode"], states["command_step"], strict=True)
        ]
    )
    torque = np.where(rows < 0, np.nan, commands["torque"][rows])
    return torque, np.where(rows < 0, np.nan, commands["displacement"][rows])


def _title(figure: Figure, summary: RideSummary) -> None:
    """One line with what matters."""
    falls = {0: "no fall", 1: "1 fall"}.get(summary.falls, f"{summary.falls} falls")
    parts = [
        f"{summary.reached} of {summary.goals} goals",
        falls,
        f"{summary.path_length:.0f} m in {summary.ridden_time:.0f} s",
    ]
    if np.isfinite(summary.path_ratio):
        parts.append(f"path {summary.path_ratio:.2f} × straight line")
    figure.suptitle("   ·   ".join(parts), fontsize=12, fontweight="bold")
