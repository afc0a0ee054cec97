"""Summary of an evaluation as aligned text and as Markdown."""

from __future__ import annotations

import math
from typing import Any

RATES = (
    ("reached the goal", "reach_rate"),
    ("fell", "fall_rate"),
    ("ran out of time", "timeout_rate"),
    ("  of these, orbits", "orbit_rate"),
)
MEASURES = (
    ("time to goal, median", "median_time_s", 1.0, "s"),
    ("time to goal, 95 %", "p95_time_s", 1.0, "s"),
    ("path over shortest, median", "path_ratio", 1.0, ""),
    ("path over shortest, mean", "path_ratio_mean", 1.0, ""),
    ("peak lean, median", "peak_lean", 180.0 / math.pi, "deg"),
    ("peak lean, largest", "peak_lean_max", 180.0 / math.pi, "deg"),
    ("torque, mean size", "mean_torque", 1.0, "N m"),
    ("displacement, mean size", "mean_displacement", 100.0, "cm"),
    ("pedal force, mean size", "mean_pedal_force", 1.0, "N"),
    ("speed, mean", "mean_speed", 1.0, "m/s"),
    ("return, mean", "mean_return", 1.0, ""),
)

Row = tuple[str, list[str]]


def rows(summaries: list[dict[str, Any]]) -> list[Row]:
    """Return a label and one cell per summary, for every line of the table."""
    table: list[Row] = [
        ("controller", [str(item["controller"]) for item in summaries]),
        ("scenario", [str(item["scenario"]["name"]) for item in summaries]),
        ("rides", [f"{item['episodes']:,}" for item in summaries]),
    ]
    table += [(label, [_rate(item, key) for item in summaries]) for label, key in RATES]
    for label, key, factor, unit in MEASURES:
        table.append((label, [_measure(item[key], factor, unit) for item in summaries]))
    return table


def _rate(summary: dict[str, Any], key: str) -> str:
    low, high = (100.0 * value for value in summary[f"{key}_interval"])
    return f"{100.0 * summary[key]:.2f} % ({low:.2f} to {high:.2f})"


def _measure(value: float | None, factor: float, unit: str) -> str:
    return "-" if value is None else f"{value * factor:.4g} {unit}".rstrip()


def as_text(summaries: list[dict[str, Any]]) -> str:
    """Return aligned columns, one per summary."""
    table = rows(summaries)
    first = max(len(label) for label, _ in table)
    widths = [max(len(cells[i]) for _, cells in table) for i in range(len(summaries))]
    lines = []
    for label, cells in table:
        padded = (cell.rjust(width) for cell, width in zip(cells, widths, strict=True))
        lines.append("  ".join([label.ljust(first), *padded]))
    return "\n".join(lines)


def as_markdown(summary: dict[str, Any]) -> str:
    """Return a Markdown table of one summary."""
    lines = ["| | |", "| --- | --- |"]
    lines += [f"| {label.strip()} | {cells[0]} |" for label, cells in rows([summary])]
    return "\n".join(lines)


def kicks_as_text(names: list[str], found: list[dict[str, Any]]) -> str:
    """Return the largest kicks caught by every controller, a line for each speed.

    Args:
        names: of the controllers.
        found: for each, `kicks` and perhaps `kicks_best` as in the JSON.
    """
    lines = []
    for name, kicks in zip(names, found, strict=True):
        if "kicks" not in kicks:
            continue
        lines += ["", f"largest kick caught by {name}, deg/s: left, right; into, out of a turn"]
        for index, row in enumerate(kicks["kicks"]):
            sizes = "{:g}, {:g}; {:g}, {:g}".format(*row["straight"], *row["turn"])
            line = f"  {row['speed']:g} m/s  {sizes}"
            if "kicks_best" in kicks:
                best = kicks["kicks_best"][index]
                line += f"; {_of_best(best)}"
            lines.append(line)
    return "\n" + "\n".join(lines) if lines else ""


def _of_best(best: dict[str, Any]) -> str:
    share = "-" if best["share"] is None else f"{best['share']:.2f}"
    return f"{share} of the best LQR's {best['caught']:g}"


def comparison_as_text(comparison: dict[str, Any]) -> str:
    """Return the result of `evaluate.compare` as text."""
    first, second = comparison["controllers"]
    shares = {
        name: f"{comparison[name]:,} ({_share(comparison, name)})"
        for name in ("first_better", "equal", "second_better")
    }
    lines = [
        f"of {comparison['episodes']:,} rides {first} does better in {shares['first_better']},",
        f"{second} in {shares['second_better']}, and {shares['equal']} are equal;",
        f"both reach the goal in {comparison['both_reach']:,}, only {first} in"
        f" {comparison['only_first_reaches']:,}, only {second} in"
        f" {comparison['only_second_reaches']:,}",
    ]
    if comparison["both_reach"]:
        less = 100.0 * (1.0 - comparison["time_ratio"])
        total = 100.0 * (1.0 - comparison["total_time_ratio"])
        lines.append(
            f"where both do, {first} is sooner in {comparison['first_sooner']:,}, as soon in"
            f" {comparison['same_time']:,} and later in {comparison['second_sooner']:,}; it saves"
            f" {comparison['time_saved_s']:.3g} s in the median ride, {less:.2f} % of the time,"
            f" and {total:.2f} % of all the time"
        )
    return "\n".join(lines)


def _share(comparison: dict[str, Any], name: str) -> str:
    share = comparison[f"{name}_share"]
    if share is None:
        return "-"
    low, high = (100.0 * value for value in comparison[f"{name}_share_interval"])
    return f"{100.0 * share:.1f} %, {low:.1f} to {high:.1f}"
