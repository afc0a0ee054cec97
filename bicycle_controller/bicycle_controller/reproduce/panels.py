"""Data of the figures, and elements shared by several of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bicycle_controller.reproduce.experiment import Experiment
from bicycle_controller.reproduce.style import colour, label
from bicycle_controller.reproduce.tables import Row, distinct


@dataclass(frozen=True)
class Data:
    """Data of a figure."""

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
        """Return the names of the trained arms."""
        return [a for a, r in distinct(self.curves, "arm", "role") if role in (None, r)]

    @property
    def lines(self) -> list[dict[str, Any]]:
        """Scores of controllers that were not trained here, for lines across a panel."""
        trained = self.arms()
        return [item for item in self.rides if item["rider"] not in trained]


def figure(width: float, height: float) -> Figure:
    """Return an empty figure; size in inches."""
    return Figure(figsize=(width, height), layout="constrained")


def experience(data: Data) -> str:
    """Return the axis label of a learning curve."""
    return f"experience (episodes of {data.experiment.limit} steps)"


def across(axes: Axes, data: Data, name: str, variant: str = "all") -> None:
    """Draw a line across for each controller that was not trained here."""
    kinds = iter((":", "--", "-."))
    for item in data.lines:
        if item["variant"] == variant and item[name][0] is not None:
            classical = item["role"] == "lqr"
            look: dict[str, Any] = {"linestyle": next(kinds) if classical else "--"}
            look |= {"color": colour(item["rider"]), "label": label(item["rider"])}
            axes.axhline(item[name][0], linewidth=1.0, **look)


def legend(axes: Axes) -> None:
    """Draw a legend, if there are entries."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend()
