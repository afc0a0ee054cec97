"""Arguments and execution of `bicycle info`."""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from bicycle_common.validation import require
from bicycle_controller.cli import options
from bicycle_sim.plants.whipple import catalogue, linear
from bicycle_sim.plants.whipple.catalogue import Described
from bicycle_sim.plants.whipple.parameters import Bicycle
from bicycle_sim.plants.whipple.plant import WhipplePlant

EPILOG = """\
BICYCLE is one of the bicycles that come with the package (without one: their list), or a YAML
file with the 25 parameters or with what you measured; docs/bicycles.md has an example of each.

Eigenvalues are those of the Whipple-Carvallo bicycle about riding straight and upright. Below the
weave speed it oscillates more and more, above the capsize speed it leans over slowly; between them
it balances itself.

examples:
  bicycle info benchmark
  bicycle info browser-rider --plot browser-rider.png
  bicycle info my-bicycle.yaml --json
"""
ROUNDED = 6
"""Decimals of the eigenvalues in the table."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `bicycle info`."""
    add = parser.add_argument
    add("bicycle", nargs="?", metavar="BICYCLE", help="a name or a YAML file (default: list them)")
    add(
        "--to",
        type=float,
        default=10.0,
        metavar="M_S",
        help="highest speed of table and chart (default: %(default)g)",
    )
    add(
        "--step",
        type=float,
        default=1.0,
        metavar="M_S",
        help="of the table (default: %(default)g)",
    )
    add(
        "--plot",
        type=Path,
        metavar="FILE",
        help="draw the eigenvalues over speed there (PNG, SVG)",
    )
    options.add_json(parser)


def run_command(args: argparse.Namespace) -> int:
    """Print the properties of a bicycle, and draw its modes on request.

    Returns:
        The exit status.

    Raises:
        ValueError: on a user's mistake; one line with the remedy.
    """
    require(
        0.0 < args.to <= linear.FASTEST, f"--to must be above 0 and at most 30, not {args.to:g}"
    )
    require(
        0.0 < args.step <= args.to, f"--step must be above 0 and at most --to, not {args.step:g}"
    )
    require(args.to / args.step <= 10_000, f"--step {args.step:g} makes a table of too many rows")
    if args.bicycle is None:
        require(args.plot is None, "--plot needs a bicycle: name one")
        found = [_listed(catalogue.load(name)) for name in catalogue.names()]
        print(json.dumps(found, indent=2) if args.json else _list_as_text(found))
        return 0
    described = catalogue.load(args.bicycle)
    require(
        described.parameters.count is None,
        "a bicycle's file must have one number for each parameter",
    )
    speeds = np.arange(0.0, args.to + 1e-9, args.step)
    facts = summary(described, speeds)
    if args.plot is not None:
        from bicycle_controller.cli.eigenvalue_chart import draw

        draw(described, args.to, args.plot)
    print(json.dumps(facts, indent=2) if args.json else as_text(facts))
    return 0


def summary(described: Described, speeds: np.ndarray) -> dict[str, Any]:
    """Return the command's result as plain data: SI units, complex numbers as [real, imaginary].

    Args:
        described: the bicycle.
        speeds: (K,) m/s of the table of eigenvalues.
    """
    b = described.parameters.bicycle
    geometry = WhipplePlant(described.parameters).geometry
    critical = linear.critical_speeds(b)
    matrices = linear.matrices(b)
    modes = linear.modes(b, speeds)
    table = [
        {"speed": float(speed), **{name: _plain(modes[name][row]) for name in linear.MODES}}
        for row, speed in enumerate(speeds)
    ]
    return {
        "name": described.name,
        "about": described.about,
        "source": described.source,
        "licence": described.licence,
        "mass": geometry.mass,
        "wheelbase": geometry.wheelbase,
        "trail": geometry.trail,
        "head_angle": 90.0 - math.degrees(geometry.steer_axis_tilt),
        "mass_forward": geometry.mass_forward,
        "mass_height": geometry.mass_height,
        "rider_leans": described.parameters.rider is not None,
        "critical_speeds": {
            "double_root": list(critical.double_root),
            "weave": list(critical.weave),
            "capsize": list(critical.capsize),
        },
        "self_stable": [
            [low, high if math.isfinite(high) else None] for low, high in critical.stable
        ],
        "matrices": {
            "M": matrices.mass.tolist(),
            "C1": matrices.damping.tolist(),
            "K0": matrices.weight.tolist(),
            "K2": matrices.centrifugal.tolist(),
        },
        "eigenvalues": table,
        "parameters": {name: float(value) for name, value in asdict(b).items()},
        "standard_deviation": described.standard_deviation,
        "estimated": list(described.estimated),
        "warnings": warnings(b),
    }


def _plain(value: Any) -> Any:
    """Return a complex number as [real, imaginary], a pair as a list of two."""
    if np.ndim(value):
        return [_plain(one) for one in value]
    return [float(value.real), float(value.imag)]


def warnings(b: Bicycle) -> list[str]:
    """Return warnings about values that no rigid body has, though measurements with errors may."""
    bodies = {
        "R": (b.IRxx, b.IRyy, b.IRxx),
        "B": (b.IBxx, b.IByy, b.IBzz),
        "H": (b.IHxx, b.IHyy, b.IHzz),
        "F": (b.IFxx, b.IFyy, b.IFxx),
    }
    found = []
    for body, (xx, yy, zz) in bodies.items():
        for name, one, others in (("xx", xx, yy + zz), ("yy", yy, xx + zz), ("zz", zz, xx + yy)):
            if one > others * (1.0 + 1e-12):
                found.append(
                    f"I{body}{name} = {one:g} exceeds the sum of the other two, {others:g}: "
                    "no rigid body has that"
                )
    return found


def _listed(described: Described) -> dict[str, Any]:
    critical = linear.critical_speeds(described.parameters.bicycle)
    return {
        "name": described.name,
        "about": described.about,
        "self_stable": [
            [low, high if math.isfinite(high) else None] for low, high in critical.stable
        ],
    }


def _list_as_text(found: list[dict[str, Any]]) -> str:
    width = max(len(item["name"]) for item in found)
    return "\n".join(f"{item['name']:{width}}  {item['about']}" for item in found)


def _ranges(ranges: list[list[float | None]]) -> str:
    """Return ranges of speed as text."""
    words = [
        f"{low:.3f} to {high:.3f} m/s" if high is not None else f"from {low:.3f} m/s on"
        for low, high in ranges
    ]
    return ", ".join(words) or "never"


def as_text(facts: dict[str, Any]) -> str:
    """Return the summary as aligned text."""
    critical = facts["critical_speeds"]

    def speeds(name: str) -> str:
        return ", ".join(f"{speed:.4f} m/s" for speed in critical[name]) or "none"

    rows = [
        ("bicycle", facts["name"] + (f": {facts['about']}" if facts["about"] else "")),
        ("source", facts["source"]),
        ("licence", facts["licence"]),
        ("mass", f"{facts['mass']:.2f} kg"),
        (
            "its centre",
            f"{facts['mass_forward']:.3f} m before the rear contact, "
            f"{facts['mass_height']:.3f} m high",
        ),
        ("wheelbase", f"{facts['wheelbase']:.3f} m"),
        ("trail", f"{facts['trail']:.4f} m"),
        ("head angle", f"{facts['head_angle']:.2f} deg"),
        ("weave speed", speeds("weave")),
        ("capsize speed", speeds("capsize")),
        ("double root", speeds("double_root")),
        ("self-stable", _ranges(facts["self_stable"])),
    ]
    if facts["rider_leans"]:
        rows.append(("speeds", "of the bicycle without the rider's upper body, which leans"))
    lines = [f"{label:14}{text}" for label, text in rows if text]
    lines += ["", "eigenvalues, 1/s", _table(facts["eigenvalues"])]
    if facts["estimated"]:
        lines += ["", "estimated, not measured:", *(f"  {line}" for line in facts["estimated"])]
    if facts["warnings"]:
        lines += ["", *(f"warning: {line}" for line in facts["warnings"])]
    return "\n".join(lines)


def _table(table: list[dict[str, Any]]) -> str:
    """Return a table with columns for speed, weave, capsize and castering."""
    lines = [f"{'m/s':>6}  {'weave':>24}  {'capsize':>12}  {'castering':>12}"]
    for row in table:
        (real, imaginary), (other, _) = row["weave"]
        weave = (
            f"{real:.{ROUNDED}f} ± {imaginary:.{ROUNDED}f}i"
            if imaginary
            else f"{real:.{ROUNDED}f}, {other:.{ROUNDED}f}"
        )
        single = [
            f"{row[name][0]:.4f}{row[name][1]:+.3f}i"
            if row[name][1]
            else f"{row[name][0]:.{ROUNDED}f}"
            for name in ("capsize", "castering")
        ]
        lines.append(f"{row['speed']:6.2f}  {weave:>24}  {single[0]:>12}  {single[1]:>12}")
    return "\n".join(lines)
