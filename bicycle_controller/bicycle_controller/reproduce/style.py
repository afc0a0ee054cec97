"""Elements shared by the figures: colours by controller, a learning curve, a coloured track."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from bicycle_common import plot_style
from bicycle_common.plot_style import INK
from bicycle_controller.reproduce.tables import Row, column, distinct, interval, select

COLOURS = {
    "paper": "#9a6324",
    "authors": "#3a5ba0",
    "naf": "#e08e0b",
    "ppo": "#8a4fa3",
    "fast": "#0b8457",
    "fixed-speed": "#0b8457",
    "small-displacement": "#c0392b",
    "learned-speed": "#c0392b",
}
LABELS = {
    "paper": "DDPG, tables 2 and 3",
    "authors": "DDPG, authors' code",
    "naf": "NAF",
    "ppo": "PPO",
    "fast": "ours (fast)",
    "fixed-speed": "ours, shipped",
    "small-displacement": "ours, shipped",
    "learned-speed": "ours, shipped",
    "lqr": "LQR",
    "lqr-20cm": "LQR with d",
    "lqr-displacement": "LQR with d",
    "lqr-displacement-pedal": "LQR with d and pedal",
}
VARIANT_COLOURS = ("#8a4fa3", "#3a5ba0", "#0b8457", "#e08e0b", "#c0392b")
STYLE: Any = plot_style.STYLE | {
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "legend.frameon": False,
    "legend.fontsize": 8,
}
STRETCHES = 20
"""Number of points of a run's curve."""
POINTS = 40
"""Number of points of a curve over several runs."""


def colour(name: str) -> str:
    """Return the colour of a controller; the classical ones are dark."""
    return COLOURS.get(name, INK)


def label(name: str) -> str:
    """Return the label of a controller in a legend."""
    return LABELS.get(name, name)


def curve(
    axes: Axes,
    rows: list[Row],
    name: str,
    look: dict[str, Any],
    factor: float = 1.0,
) -> bool:
    """Draw the mean of a column over the runs of `rows`, with its 95 % interval as a band.

    Beyond the end of the shortest run the longer ones continue as thin lines, one each.

    Returns:
        True if there was anything to draw.
    """
    runs = []
    for (seed,) in distinct(rows, "seed"):
        mine = select(rows, seed=seed)
        at, values = column(mine, "at"), factor * column(mine, name)
        finite = np.isfinite(values)
        if finite.any():
            runs.append((_thinned(at[finite]), _thinned(values[finite])))
    if not runs:
        return False
    end = min(at[-1] for at, _ in runs)
    grid = np.linspace(min(at[0] for at, _ in runs), end, POINTS)
    lines = np.array([np.interp(grid, at, values) for at, values in runs])
    spread = np.array([interval(lines[:, index]) for index in range(POINTS)], dtype=np.float64)
    axes.plot(grid, spread[:, 0], linewidth=1.6, **look)
    if len(runs) > 1:
        band = {"color": look["color"], "alpha": 0.18, "linewidth": 0}
        axes.fill_between(grid, spread[:, 1], spread[:, 2], **band)
    alone = {name: value for name, value in look.items() if name != "label"}
    for at, values in runs:
        axes.plot(at[at >= end], values[at >= end], linewidth=0.7, **alone)
    return True


def _thinned(values: np.ndarray) -> np.ndarray:
    """Average neighbours, so that no more than STRETCHES values are left."""
    width = -(-len(values) // STRETCHES)
    return np.array([values[i : i + width].mean() for i in range(0, len(values), width)])


def by_age(axes: Axes, rows: list[Row]) -> LineCollection:
    """Draw tracks coloured from early (blue) to late (red)."""
    lines, ages = [], []
    for (episode,) in distinct(rows, "episode"):
        mine = select(rows, episode=episode)
        lines.append(np.stack([column(mine, "x"), column(mine, "y")], axis=1))
        ages.append(mine[0]["age"])
    drawn = LineCollection(lines, cmap="coolwarm", linewidths=1.0, alpha=0.85, zorder=3)
    drawn.set_array(np.array(ages, dtype=np.float64))
    drawn.set_clim(0.0, 1.0)
    axes.add_collection(drawn)
    return drawn


def as_map(axes: Axes) -> None:
    """Set equal scales in x and y, in metres."""
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.05)
    axes.autoscale_view()
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
