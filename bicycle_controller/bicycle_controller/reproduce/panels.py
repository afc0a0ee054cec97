"""What figures are drawn from, and what several of them have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bicycle_controller.reproduce import style
from bicycle_controller.reproduce.experiment import Experiment
from bicycle_controller.reproduce.style import label
from bicycle_controller.reproduce.tables import Row, distinct


@dataclass(frozen=True)
class Data:
    """What a figure is drawn from."""

    experiment: Experiment
    mode: str
    curves: list[Row]
    evaluations: list[Row]
    tracks: list[Row]
    ways: list[Row]
    states: list[Row]
    profiles: list[Row]
    rides: list[dict[str, Any]]
    """Summarised, see `summary.rides`."""

    def arms(self, role: str | None = None) -> list[str]:
        """Names of what was trained."""
        return [a for a, r in distinct(self.curves, "arm", "role") if role in (None, r)]

    @property
    def lines(self) -> list[dict[str, Any]]:
        """Scores of the classical controllers, for lines across a panel."""
        return [item for item in self.rides if item["role"] == "lqr"]


def figure(width: float, height: float) -> Figure:
    """An empty figure, inches."""
    return Figure(figsize=(width, height), layout="constrained")


def experience(data: Data) -> str:
    """What the axis of a learning curve says."""
    return f"experience (episodes of {data.experiment.limit} steps)"


def across(axes: Axes, data: Data, name: str, variant: str = "all") -> None:
    """A line across for each classical controller."""
    kinds = iter((":", "--", "-."))
    for item in data.lines:
        if item["variant"] == variant and item[name][0] is not None:
            look: dict[str, Any] = {"color": style.INK, "linewidth": 1.0, "linestyle": next(kinds)}
            axes.axhline(item[name][0], label=label(item["rider"]), **look)


def legend(axes: Axes) -> None:
    """A legend, where there is anything to tell."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend()
