"""Figures of the page, each for one or two rides side by side on equal axes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from bicycle_common.plot_style import FAINT, INK
from bicycle_tools.drawing import FAILED, LEAN, REACHED, SHIFT, STEER, TORQUE, Floats, envelope
from bicycle_tools.report_page.events import RideEvent, ride_events
from bicycle_tools.report_page.loading import RidePage
from bicycle_tools.ride_log import Columns
from bicycle_tools.track import draw_track

Canvas = Figure | SubFigure
MOST_POINTS = 2400
"""Largest number of points of a line: two for every horizontal pixel."""
MOST_MARKS = 400
"""Largest number of lines and bands in a strip; more would be illegible."""
SHADES = {"watchdog": FAILED, "held": SHIFT}


@dataclass(frozen=True)
class Strip:
    """Quantity over time.

    Attributes:
        label: of the axis, with the unit.
        column: of the messages.
        colour: the line's colour.
        scale: from SI to the unit.
    """

    label: str
    column: str
    colour: str
    scale: float = 1.0


DEGREES = 180.0 / np.pi
STATE_STRIPS = (
    Strip("lean (°)", "lean_angle", LEAN, DEGREES),
    Strip("lean rate (°/s)", "lean_rate", LEAN, DEGREES),
    Strip("steering (°)", "steer_angle", STEER, DEGREES),
    Strip("steer rate (°/s)", "steer_rate", STEER, DEGREES),
    Strip("heading\nerror (°)", "heading_error", TORQUE, DEGREES),
    Strip("speed (m/s)", "speed", REACHED),
    Strip("distance to\ngoal (m)", "goal_distance", INK),
)
COMMAND_STRIPS = (
    Strip("torque (N m)", "torque", TORQUE),
    Strip("displace-\nment (cm)", "displacement", SHIFT, 100.0),
    Strip("pedal\nforce (N)", "pedal_force", STEER),
)


def draw_tracks(canvas: Canvas, pages: Sequence[RidePage]) -> None:
    """Draw each ride's track over the plane, to one scale."""
    row = canvas.subplots(1, len(pages), squeeze=False, sharex=True, sharey=True)[0]
    for axes, page in zip(row, pages, strict=True):
        draw_track(canvas, axes, page.log)
        if len(pages) > 1:  # axes with shared limits can only change their shape
            axes.set_aspect("equal", adjustable="box")
            axes.tick_params(labelleft=True)
        _name(axes, page, pages, pad=10)


def draw_states(canvas: Canvas, pages: Sequence[RidePage]) -> None:
    """Draw the state over simulated time, with falls, resets, goals and missing commands."""
    _strips(canvas, pages, STATE_STRIPS, lambda page: (page.log.states, page.state_time))


def draw_commands(canvas: Canvas, pages: Sequence[RidePage]) -> None:
    """Draw the sent commands over simulated time."""
    _strips(canvas, pages, COMMAND_STRIPS, _command_time)


def _command_time(page: RidePage) -> tuple[Columns, Floats]:
    return page.log.commands, page.step_time(page.log.commands)


def _strips(
    canvas: Canvas,
    pages: Sequence[RidePage],
    strips: Sequence[Strip],
    take: Callable[[RidePage], tuple[Columns, Floats]],
) -> None:
    grid = canvas.subplots(len(strips), len(pages), squeeze=False, sharex=True, sharey="row")
    for page, column in zip(pages, grid.T, strict=True):
        columns, time = take(page)
        marks = ride_events(page)
        for strip, axes in zip(strips, column, strict=True):
            if strip.column in columns and len(time):
                values = strip.scale * np.asarray(columns[strip.column], dtype=np.float64)
                axes.plot(*envelope(time, values, MOST_POINTS), color=strip.colour, linewidth=0.9)
            _mark(axes, marks)
            _mark_goals(axes, page)
            axes.margins(x=0.0)
        column[-1].set_xlabel("time (s)")
        _name(column[0], page, pages)
    for strip, axes in zip(strips, grid[:, 0], strict=True):
        axes.set_ylabel(strip.label, color=strip.colour)
    canvas.align_ylabels(list(grid[:, 0]))


def _name(axes: Axes, page: RidePage, pages: Sequence[RidePage], pad: float = 6) -> None:
    """Write the ride's name above its column, if there are two."""
    if len(pages) > 1:
        axes.set_title(page.name, loc="left", fontsize=10, fontweight="bold", pad=pad)


def _mark(axes: Axes, marks: Sequence[RideEvent]) -> None:
    """Draw lines at resets and falls, and bands where commands were missing."""
    lines = [mark for mark in marks if mark.kind in ("reset", "fall")]
    for mark in lines[:MOST_MARKS]:
        fell = mark.kind == "fall"
        style = "-" if fell else ":"
        axes.axvline(mark.time, color=FAILED if fell else FAINT, linewidth=1.0, linestyle=style)
    bands = [mark for mark in marks if mark.kind in SHADES]
    for mark in bands[:MOST_MARKS]:
        colour = SHADES[mark.kind]
        axes.axvspan(mark.time, mark.until, color=colour, alpha=0.25, linewidth=0.8)


def _mark_goals(axes: Axes, page: RidePage) -> None:
    """Draw a thin line at each goal's end."""
    for time in page.ends_of(page.outcomes)[:MOST_MARKS]:
        axes.axvline(time, color=REACHED, linewidth=0.7, alpha=0.5, zorder=0)
