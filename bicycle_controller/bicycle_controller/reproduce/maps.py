"""Figures with tracks of the rear wheel: 12 to 16."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bicycle_common.plot_style import FAINT, INK
from bicycle_controller.reproduce import style
from bicycle_controller.reproduce.panels import Data, across, experience, figure, legend
from bicycle_controller.reproduce.style import colour, curve, label
from bicycle_controller.reproduce.tables import column, distinct, select


def displacement(data: Data) -> Figure:
    """Figure 12: learning curves for every displacement, and the tracks during training."""
    variants = data.experiment.variants
    if not data.curves:
        drawing = figure(9.5, 4.2)
        _reached_by_variant(drawing.subplots(), data)
        return drawing
    drawing = figure(13.0, 7.2)
    upper, lower = drawing.subfigures(2, 1, height_ratios=(1.15, 1.0), squeeze=False)[:, 0]
    roles = [role for role in ("authors", "best") if data.arms(role)]
    top = upper.subplots(1, len(roles) + 1, squeeze=False)[0]
    for axes, role in zip(top, roles, strict=False):
        _by_variant(axes, data, role)
    _reached_by_variant(top[-1], data)
    ridden = [variant for variant in variants if select(data.tracks, variant=variant.name)]
    maps = lower.subplots(1, max(3, len(ridden)))
    for axes, variant in zip(maps, ridden, strict=False):
        aged(axes, data, variant.name, variant.label)
    for axes in maps[len(ridden) :]:
        axes.set_axis_off()
    return drawing


def _by_variant(axes: Axes, data: Data, role: str) -> None:
    """Draw the learning curves of an arm on every variant."""
    for index, variant in enumerate(data.experiment.variants):
        look: dict[str, Any] = {"color": style.VARIANT_COLOURS[index], "label": variant.label}
        for arm in data.arms(role):
            mine = {"arm": arm, "variant": variant.name}
            if role == "best":
                curve(axes, select(data.evaluations, **mine), "mean_return", look)
            else:
                curve(axes, select(data.curves, **mine), "return", look)
            axes.set_title(f"{label(arm)}: return")
    axes.set_xlabel(experience(data))
    legend(axes)


def _reached_by_variant(axes: Axes, data: Data) -> None:
    """Draw the share of goals that each controller reaches on each variant."""
    variants = [variant.name for variant in data.experiment.variants]
    for (rider,) in distinct(data.rides, "rider"):
        mine = {item["variant"]: item for item in select(data.rides, rider=rider)}
        rates = [100.0 * mine[name]["reached"][0] if name in mine else np.nan for name in variants]
        dark = rider.startswith("lqr")
        kind = ":" if rider == "lqr" else "--" if dark or rider == "fixed-speed" else "-"
        look: dict[str, Any] = {
            "color": colour(rider),
            "linestyle": kind,
            "marker": "o",
            "markersize": 3,
        }
        axes.plot(range(len(variants)), rates, label=label(rider), **look)
    axes.set_xticks(range(len(variants)), [v.label for v in data.experiment.variants], fontsize=7)
    axes.set_ylim(-4, 104)
    axes.set_title("goals reached without noise (%)")
    legend(axes)


def aged(axes: Axes, data: Data, variant: str, title: str) -> None:
    """Draw tracks during training, early in blue and late in red."""
    rows = select(data.tracks, variant=variant)
    if rows:
        title = f"{title}, {label(rows[0]['rider'])}"
        style.by_age(axes, rows)
    axes.set_title(title, fontsize=8)
    goal = data.experiment.ridden(data.experiment.variant(variant)).goal
    if goal.low == goal.high:
        axes.plot(*goal.low, marker="*", markersize=10, color="#e0b400", markeredgecolor=INK)
    style.as_map(axes)


def goals(data: Data) -> Figure:
    """Draw figures 13 and 14: return, steps, tracks during training and of the trained bicycle."""
    if not data.curves:
        drawing = figure(7.0, 6.4)
        _trained_ways(drawing.subplots(), data)
        return drawing
    drawing = figure(12.0, 8.4)
    (returns, steps), (learning, trained) = drawing.subplots(2, 2)
    return_panel(returns, data)
    steps_panel(steps, data)
    aged(learning, data, "all", "while learning, blue early, red late")
    _trained_ways(trained, data)
    return drawing


def _trained_ways(trained: Axes, data: Data) -> None:
    """Draw tracks of the trained bicycle from its starts (dots) to its goals (stars)."""
    rides = distinct(data.ways, "ride", "reached")
    for ride, reached in rides:
        mine = select(data.ways, ride=ride)
        shade = style.COLOURS["fast"] if reached else "#c0392b"
        trained.plot(column(mine, "x"), column(mine, "y"), color=shade, linewidth=0.8)
        trained.plot(mine[0]["x"], mine[0]["y"], ".", color=FAINT, markersize=3)
        trained.plot(mine[-1]["x"], mine[-1]["y"], "*", color="#e0b400", markersize=6, zorder=4)
    got = sum(reached for _, reached in rides)
    name = label(data.ways[0]["rider"]) if data.ways else ""
    trained.set_title(f"{name}: {got} of {len(rides)} rides reach their goal")
    style.as_map(trained)


def return_panel(axes: Axes, data: Data) -> None:
    """Draw training returns, ours also without noise, and lines for classical controllers."""
    many = len(data.experiment.variants) > 1
    for arm, role, variant in distinct(data.curves, "arm", "role", "variant"):
        second = many and variant == data.experiment.variants[1].name
        look: dict[str, Any] = {"color": colour(arm), "linestyle": "--" if second else "-"}
        text = f", {data.experiment.variant(variant).label}" if many else ""
        mine = {"arm": arm, "variant": variant}
        if role == "best":
            look["label"] = f"{label(arm)}{text}, no noise"
            curve(axes, select(data.evaluations, **mine), "mean_return", look)
        else:
            look["label"] = f"{label(arm)}{text}"
            curve(axes, select(data.curves, **mine), "return", look)
    if not many:
        across(axes, data, "return")
    axes.set_title("return of an episode")
    axes.set_xlabel(experience(data))
    legend(axes)


def steps_panel(axes: Axes, data: Data) -> None:
    """Draw the steps of training episodes, for ours the median of arrivals without noise."""
    for arm, role in distinct(data.curves, "arm", "role"):
        look: dict[str, Any] = {"color": colour(arm), "label": label(arm)}
        if role == "best":
            look["label"] += ", no noise, median of rides that arrive"
            rows = select(data.evaluations, arm=arm)
            curve(axes, rows, "median_time_s", look, factor=40.0)
        else:
            curve(axes, select(data.curves, arm=arm), "steps", look)
    across(axes, data, "steps")
    axes.set_title("steps to the goal")
    axes.set_ylim(bottom=0)
    axes.set_xlabel(experience(data))
    legend(axes)


def turn(data: Data) -> Figure:
    """Figure 15: return, tracks with and without the pedal, the speed of a turn."""
    pedal = data.experiment.variants[0].name
    if not data.curves:
        drawing = figure(7.0, 4.4)
        profile_panel(drawing.subplots(), data, pedal)
        return drawing
    drawing = figure(12.0, 8.4)
    (returns, with_pedal), (without, speed) = drawing.subplots(2, 2)
    return_panel(returns, data)
    for axes, variant in zip((with_pedal, without), data.experiment.variants, strict=True):
        aged(axes, data, variant.name, variant.label)
    profile_panel(speed, data, pedal)
    return drawing


def profile_panel(axes: Axes, data: Data, variant: str) -> None:
    """Draw the mean speed by step with the middle 95 % of the rides, and the heading error."""
    other = axes.twinx()
    other.grid(visible=False)
    for (rider,) in distinct(select(data.profiles, variant=variant), "rider"):
        mine = select(data.profiles, rider=rider, variant=variant)
        step, shade = column(mine, "step"), colour(rider)
        axes.plot(step, column(mine, "speed"), color=shade, linewidth=1.6, label=label(rider))
        band: dict[str, Any] = {"color": shade, "alpha": 0.12, "linewidth": 0}
        axes.fill_between(step, column(mine, "speed_low"), column(mine, "speed_high"), **band)
        error = np.degrees(column(mine, "heading_error"))
        other.plot(step, error, color=shade, linewidth=0.9, linestyle=":")
    axes.set_title("speed (solid, middle 95 % shaded) and heading error (dotted)")
    axes.set_xlabel("step")
    axes.set_ylabel("speed (m/s)")
    other.set_ylabel("mean |ψ_g| (°)")
    legend(axes)


def speed(data: Data) -> Figure:
    """Figure 16: return, steps, distance to the goal at the end, and speed."""
    if not data.curves:
        drawing = figure(7.0, 4.4)
        profile_panel(drawing.subplots(), data, "all")
        return drawing
    drawing = figure(12.0, 8.4)
    (returns, steps), (distance, speed) = drawing.subplots(2, 2)
    return_panel(returns, data)
    steps_panel(steps, data)
    for arm, role in distinct(data.curves, "arm", "role"):
        text = f"{label(arm)}, its own training episodes" if role == "best" else label(arm)
        look: dict[str, Any] = {"color": colour(arm), "label": text}
        curve(distance, select(data.curves, arm=arm), "distance", look)
    distance.set_title("distance to the goal at the end of an episode (m)")
    distance.set_ylim(bottom=0)
    distance.set_xlabel(experience(data))
    legend(distance)
    profile_panel(speed, data, "all")
    return drawing
