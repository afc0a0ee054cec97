"""Figures in the paper's form: each kind is a function of an experiment and its data."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bicycle_common.plot_style import FAINT
from bicycle_controller.reproduce import style, summary
from bicycle_controller.reproduce.experiment import Experiment
from bicycle_controller.reproduce.maps import displacement, goals, speed, turn
from bicycle_controller.reproduce.panels import Data, across, experience, figure, legend
from bicycle_controller.reproduce.style import colour, curve, label
from bicycle_controller.reproduce.tables import column, distinct, read_table, select

PICTURE = "figure.png"
TERM_LABELS = {
    "lean_angle": ("−ω²", "#3a5ba0"),
    "lean_rate": ("−0.1 ω̇²", "#0b8457"),
    "lean_acceleration": ("−0.01 ω̈²", "#e08e0b"),
    "heading_error": ("−2 ψ_g²", "#c0392b"),
}
STATE_LABELS = {
    "lean_angle": ("ω, lean (°)", True),
    "lean_rate": ("ω̇ (°/s)", True),
    "lean_acceleration": ("ω̈ (°/s²)", True),
    "steer_angle": ("θ, steering (°)", True),
    "steer_rate": ("θ̇ (°/s)", True),
    "heading_error": ("ψ_g, heading error (°)", True),
}


def draw(experiment: Experiment, folder: Path) -> None:
    """Draw `folder`'s data into its figure.png."""
    names = (summary.CURVES, summary.EVALUATIONS, summary.TRACKS, summary.WAYS)
    curves, scored, tracks, ways = (read_table(folder / name) for name in names)
    states, profiles = (read_table(folder / n) for n in (summary.STATES, summary.PROFILES))
    scores = json.loads((folder / "summary.json").read_text())["rides"]
    mode = folder.name
    data = Data(experiment, mode, curves, scored, tracks, ways, states, profiles, scores)
    with mpl.rc_context(style.STYLE):
        drawing = KINDS[experiment.picture](data)
        title = f"{experiment.title} · {data.mode} physics"
        drawing.suptitle(title, fontsize=11, fontweight="bold", x=0.01, ha="left")
        drawing.savefig(folder / PICTURE, dpi=110)


def _terms(data: Data) -> Figure:
    """Figure 9: a panel per arm, a curve per term."""
    arms = data.arms()
    drawing = figure(max(7.0, 4.0 * len(arms) + 0.6), 3.6)
    panels = drawing.subplots(1, max(1, len(arms)), sharey=True, squeeze=False)[0]
    for axes, arm in zip(panels, arms, strict=False):
        for term, (text, shade) in TERM_LABELS.items():
            look: dict[str, Any] = {"color": shade, "label": text}
            curve(axes, select(data.curves, arm=arm), term, look, factor=-1.0)
        axes.set_yscale("log")
        axes.set_ylim(bottom=10.0)
        axes.set_title(label(arm))
        axes.set_xlabel(experience(data))
        legend(axes)
    panels[0].set_ylabel("size of the term, sum over an episode")
    return drawing


def _learning(data: Data) -> Figure:
    """Figure 10: returns while training, and without noise."""
    drawing = figure(11.0, 4.2)
    left, right = drawing.subplots(1, 2, sharey=True)
    for arm in data.arms():
        look: dict[str, Any] = {"color": colour(arm), "label": label(arm)}
        if arm not in data.arms("best"):
            curve(left, select(data.curves, arm=arm), "return", look)
        curve(right, select(data.evaluations, arm=arm), "mean_return", look)
    across(right, data, "return")
    left.set_title("while training, with exploration")
    right.set_title("without noise, on the same 256 or 250 starts")
    left.set_ylabel("return of an episode")
    _limit_below(left, data)
    for axes in (left, right):
        axes.set_xlabel(experience(data))
        legend(axes)
    return drawing


def _limit_below(axes: Axes, data: Data) -> None:
    """Limit the axis so that one far lower return does not squeeze the others together."""
    values = np.concatenate(
        [column(data.curves, "return"), column(data.evaluations, "mean_return")]
    )
    values = values[np.isfinite(values)]
    if len(values):
        axes.set_ylim(1.05 * float(np.quantile(values, 0.01)), 0.02 * abs(float(values.min())))


def _states(data: Data) -> Figure:
    """Figure 11: six states over time."""
    drawing = figure(11.0, 5.2)
    panels = drawing.subplots(2, 3, sharex=True)
    for axes, (name, (text, angular)) in zip(panels.flat, STATE_LABELS.items(), strict=True):
        for (rider,) in distinct(data.states, "rider"):
            mine = select(data.states, rider=rider)
            values = np.degrees(column(mine, name)) if angular else column(mine, name)
            if not mine[0]["reached"]:
                continue  # the paper shows a ride that succeeds
            look: dict[str, Any] = {
                "color": colour(rider),
                "linewidth": 1.2,
                "label": label(rider),
            }
            axes.plot(column(mine, "time"), values, **look)
        axes.set_ylabel(text)
        axes.axhline(0.0, color=FAINT, linewidth=0.6)
    for axes in panels[1]:
        axes.set_xlabel("time (s)")
    legend(panels[0, 0])
    return drawing


def _robustness(data: Data) -> Figure:
    """Draw the share of goals reached, by controller and disturbance."""
    variants = data.experiment.variants
    riders = [rider for (rider,) in distinct(data.rides, "rider")]
    table = np.full((len(riders), len(variants)), np.nan)
    for item in data.rides:
        place = [variant.name for variant in variants].index(item["variant"])
        table[riders.index(item["rider"]), place] = item["reached"][0]
    return _shares(riders, [variant.label for variant in variants], table)


def _cause(data: Data) -> Figure:
    """Share of goals reached, by controller and by what differs, or else by run."""
    if len(data.experiment.variants) > 1:
        return _robustness(data)
    riders = [rider for (rider,) in distinct(data.rides, "rider")]
    runs = max((item["runs"] for item in data.rides), default=1)
    table = np.full((len(riders), runs), np.nan)
    for row, item in enumerate(data.rides):
        table[row, : item["runs"]] = item["reached_by_run"]
    return _shares(riders, [f"run {number}" for number in range(1, runs + 1)], table)


def _shares(riders: list[str], columns: list[str], table: np.ndarray) -> Figure:
    """Draw a coloured table of shares, NaN if there is none."""
    width = max(8.0, 12.0 * min(1.0, len(columns) / 15))
    drawing = figure(width, 1.9 + 0.38 * len(riders))
    axes = drawing.subplots()
    axes.grid(visible=False)
    shown = axes.imshow(100.0 * table, cmap="RdYlGn", vmin=0, vmax=100, aspect="auto", alpha=0.6)
    turned: dict[str, Any] = {"rotation": 35, "ha": "right"} if len(columns) > 5 else {}
    axes.set_xticks(range(len(columns)), columns, **turned)
    axes.set_yticks(range(len(riders)), [label(rider) for rider in riders])
    for (row, place), value in np.ndenumerate(100.0 * table):
        if np.isfinite(value):
            axes.text(place, row, f"{value:.0f}", ha="center", va="center", fontsize=8)
    drawing.colorbar(shown, ax=axes, label="goals reached (%)", pad=0.01)
    return drawing


KINDS: dict[str, Callable[[Data], Figure]] = {
    "terms": _terms,
    "learning": _learning,
    "states": _states,
    "displacement": displacement,
    "goals": goals,
    "turn": turn,
    "speed": speed,
    "robustness": _robustness,
    "cause": _cause,
}
