"""Figure of the loop's timing: rate, period and the latency from state to command."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from bicycle_common.plot_style import FAINT
from bicycle_tools.drawing import LEAN, STEER, TORQUE, Floats, drawable, envelope
from bicycle_tools.report_page.figures import MOST_POINTS, Canvas
from bicycle_tools.report_page.loading import RidePage

COLOURS = (LEAN, STEER)
"""Colours of the first and the second ride on shared axes."""
RATE_STEPS = 40
"""Number of steps averaged in one point of the rate."""
LEAST_RANGE = 1.0
"""Least range of the rate's axis (Hz)."""
BINS = 60


@dataclass(frozen=True)
class Row:
    """One duration of LoopTiming; in ms on the page."""

    column: str
    label: str
    colour: str


ROWS = (
    Row("period", "period (ms)", LEAN),
    Row("latency", "state to\ncommand (ms)", TORQUE),
)


def draw_timing(canvas: Canvas, pages: Sequence[RidePage]) -> None:
    """Draw rate and durations over time, and histograms of the durations."""
    count = len(pages)
    widths = [1.0] * count + [0.62]
    grid = canvas.subplots(1 + len(ROWS), count + 1, squeeze=False, width_ratios=widths)
    for number, page in enumerate(pages):
        time = page.step_time(page.log.timing)
        _rate(grid[0, number], page, time)
        for row, axes in zip(ROWS, grid[1:, number], strict=True):
            values = _milliseconds(page, row.column)
            axes.plot(*envelope(time, values, MOST_POINTS), color=row.colour, linewidth=0.7)
        if count > 1:
            grid[0, number].set_title(page.name, loc="left", fontsize=10, fontweight="bold")
        grid[-1, number].set_xlabel("time (s)")
    _share(grid[:, :count])
    _widen(grid[0, 0])
    grid[0, 0].set_ylabel("rate (Hz)", color=FAINT)
    for row, axes in zip(ROWS, grid[1:, 0], strict=True):
        axes.set_ylabel(row.label, color=row.colour)
    _key(grid[0, -1], pages)
    for row, axes in zip(ROWS, grid[1:, -1], strict=True):
        _histogram(axes, row, pages)
    canvas.align_ylabels(list(grid[:, 0]))


def _share(columns: np.ndarray[tuple[int, int], np.dtype[np.object_]]) -> None:
    """Set equal limits: of time down each column, of values along each row."""
    for row in columns:
        for axes in row[1:]:
            axes.sharey(row[0])
    for axes in columns.ravel()[1:]:
        axes.sharex(columns[0, 0])
    for axes in columns.ravel():
        axes.margins(x=0.0)


def _milliseconds(page: RidePage, column: str) -> Floats:
    return drawable(1e3 * np.asarray(page.log.timing.get(column, ()), dtype=np.float64))


def _rate(axes: Axes, page: RidePage, time: Floats) -> None:
    """Draw the steps per second, averaged over some steps."""
    periods = 1e-3 * _milliseconds(page, "period")
    whole = len(periods) // RATE_STEPS * RATE_STEPS
    if not whole:
        return
    blocks = periods[:whole].reshape(-1, RATE_STEPS)
    known = np.isfinite(blocks)
    total = np.where(known, blocks, 0.0).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = known.sum(axis=1) / total
    middle = time[:whole].reshape(-1, RATE_STEPS)[:, RATE_STEPS // 2]
    axes.plot(*envelope(middle, rate, MOST_POINTS), color=FAINT, linewidth=1.2)


def _widen(axes: Axes) -> None:
    """Widen the range of the rate so that a clock's noise is not magnified."""
    low, high = axes.get_ylim()
    if high - low < LEAST_RANGE:
        middle = 0.5 * (low + high)
        axes.set_ylim(middle - 0.5 * LEAST_RANGE, middle + 0.5 * LEAST_RANGE)


def _histogram(axes: Axes, row: Row, pages: Sequence[RidePage]) -> None:
    """Draw a histogram of durations on a logarithmic axis, which shows the tail."""
    found = [_milliseconds(page, row.column) for page in pages]
    finite = [values[np.isfinite(values)] for values in found]
    everything = np.concatenate(finite)
    axes.set_xlabel(row.label.replace("\n", " "))
    axes.set_ylabel("steps", color=FAINT)
    if not len(everything):
        return
    edges = np.histogram_bin_edges(everything, bins=BINS).tolist()
    colours = COLOURS if len(pages) > 1 else (row.colour,)
    for values, colour in zip(finite, colours, strict=False):
        if len(values):
            axes.hist(
                values, bins=edges, log=True, color=colour, alpha=0.55, histtype="stepfilled"
            )


def _key(axes: Axes, pages: Sequence[RidePage]) -> None:
    """Draw the key of the rides' colours in the histograms."""
    axes.set_axis_off()
    if len(pages) > 1:
        for page, colour in zip(pages, COLOURS, strict=True):
            axes.fill_between([], [], color=colour, alpha=0.55, label=page.name)
        axes.legend(loc="lower left", frameon=False)
