"""Chart of a bicycle's modes: real and imaginary parts of the eigenvalues over speed."""

from __future__ import annotations

import math
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bicycle_common.plot_style import FAINT, INK
from bicycle_controller.reproduce.style import STYLE
from bicycle_sim.plants.whipple import linear
from bicycle_sim.plants.whipple.catalogue import Described

POINTS = 1001
"""Number of speeds along a curve."""
COLOURS = {"weave": "#3a5ba0", "capsize": "#e08e0b", "castering": "#0b8457"}
STABLE = "#e3f4ec"
DAMPED = 15.0
"""Lower end of the chart, 1/s below zero; castering leaves it at some speed."""


def draw(described: Described, fastest: float, path: Path) -> None:
    """Write the chart.

    Args:
        described: the bicycle.
        fastest: right end of the speed axis, m/s.
        path: of the file; its suffix selects the format.

    Raises:
        ValueError: on a suffix that matplotlib does not support.
    """
    bicycle = described.parameters.bicycle
    speeds = np.linspace(0.0, fastest, POINTS)
    modes = linear.modes(bicycle, speeds)
    critical = linear.critical_speeds(bicycle)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7.0, 4.6), layout="constrained")
        axes = figure.subplots()
        for low, high in critical.stable:
            axes.axvspan(low, min(high, fastest), color=STABLE, zorder=0)
        for name in linear.MODES:
            values = modes[name].reshape(POINTS, -1)
            for column in values.T:
                axes.plot(speeds, column.real, color=COLOURS[name], linewidth=1.6)
            swings = np.where(np.abs(values.imag) > 1e-9, np.abs(values.imag), np.nan)
            axes.plot(speeds, swings[:, 0], color=COLOURS[name], linewidth=1.2, linestyle="--")
            _name(axes, name, speeds, values.real[:, 0])
        axes.axhline(0.0, color=INK, linewidth=0.8)
        low, high = -DAMPED, max(10.0, float(np.abs(modes["weave"].imag).max()))
        axes.set(
            xlim=(0.0, fastest),
            ylim=(low, high),
            xlabel="speed, m/s",
            ylabel="eigenvalues, 1/s: real part —, imaginary part - -",
        )
        axes.set_title(_title(described, critical), loc="left")
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=150)


def _title(described: Described, critical: linear.CriticalSpeeds) -> str:
    ranges = [
        f"{low:.2f} to {high:.2f} m/s" if math.isfinite(high) else f"above {low:.2f} m/s"
        for low, high in critical.stable
    ]
    balance = f"balances itself at {', '.join(ranges)}" if ranges else "never balances itself"
    return f"{described.name}: {balance}"


def _name(axes: Axes, name: str, speeds: np.ndarray, real: np.ndarray) -> None:
    """Write a mode's name beside its curve, within the chart."""
    seen = np.flatnonzero(real > -DAMPED + 1.0)
    if not len(seen):
        return
    index = seen[int(0.75 * (len(seen) - 1))]
    axes.annotate(
        name,
        (float(speeds[index]), float(real[index])),
        xytext=(4, 5),
        textcoords="offset points",
        color=COLOURS.get(name, FAINT),
    )
