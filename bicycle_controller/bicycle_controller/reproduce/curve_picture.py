"""The picture of `bicycle plot`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from bicycle_controller.training.learning_curves import AXES, Curve


def draw(curves: Sequence[Curve], value: str, over: str, path: Path) -> None:
    """Write the curves as a picture, in the format of the file's ending.

    Raises:
        ValueError: if matplotlib does not know that ending.
        OSError: if it cannot be written.
    """
    figure = Figure(figsize=(8.0, 4.8), layout="constrained")
    axes = figure.add_subplot()
    colours = mpl.color_sequences["tab10"]
    for index, curve in enumerate(curves):
        colour = colours[index % len(colours)]
        seeds = f"{curve.seeds} seed{'s' * (curve.seeds > 1)}"
        marker = "o" if len(curve.at) < 3 else None
        axes.plot(
            curve.at, curve.middle, color=colour, marker=marker, label=f"{curve.name}, {seeds}"
        )
        if curve.seeds > 1:
            axes.fill_between(
                curve.at, curve.low, curve.high, color=colour, alpha=0.2, linewidth=0
            )
    axes.set(xlabel=AXES[over], ylabel=value.replace("_", " "))
    if value.endswith("rate"):
        axes.set_ylim(-0.02, 1.02)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, fontsize="small")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=150)
