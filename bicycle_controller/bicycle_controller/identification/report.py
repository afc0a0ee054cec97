"""Result of an identification as plain data, as text and as a bicycle's file."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from bicycle_common import yaml_text
from bicycle_controller.identification.identify import Identified, Mode
from bicycle_controller.identification.unknowns import EXTRAS

UNITS = {"damping": "N m s/rad", "lag": "s", "delay": "s"}


def as_data(found: Identified) -> dict[str, Any]:
    """Return the result as plain data, SI units."""
    p, fit = found.parameters, found.fit
    errors, undetermined = found.errors(), found.undetermined()
    before = fit.unknowns.parameters(np.zeros(len(fit.x)))
    sizes = fit.unknowns.in_units(np.zeros(len(fit.x)))
    extra, extra_before = (
        {"damping": q.steering.damping, "lag": q.motor.lag, "delay": q.delay} for q in (p, before)
    )
    rows = {}
    for name, size in zip(fit.unknowns.names, sizes, strict=True):
        is_extra = name in EXTRAS
        rows[name] = {
            "value": float(extra[name] if is_extra else getattr(p.bicycle, name)),
            "standard_error": errors[name],
            "before": float(extra_before[name] if is_extra else getattr(before.bicycle, name)),
            "before_deviation": float(size),
            "determined": name not in undetermined,
        }
    count, combinations = found.combinations()
    return {
        "logs": [
            {
                "name": log.name,
                "seconds": log.seconds,
                "rate": 1.0 / log.pieces[0].dt,
                "pieces": len(log.pieces),
                "law": None if law is None else {"constant": law[0], "per_speed": law[1]},
            }
            for log, law in zip(found.logs, found.laws, strict=True)
        ],
        "fitted_to": "modes after pushes" if found.by_pushes else "the whole ride",
        "noise": {"lean_rate": float(found.noise[0]), "steer_angle": float(found.noise[1])},
        "misfit": None if found.by_pushes else list(fit.misfit),
        "parameters": rows,
        "not_determined": undetermined,
        "determined_combinations": {"count": count, "of": len(fit.x), "largest": combinations},
        "modes": [asdict(mode) for mode in found.modes],
        "measured_modes": [one._asdict() for one in found.measured],
        "held_out": {
            "what": found.held_out_names,
            "explained_ahead": _finite(found.held_out[0].explained),
            "error_ahead": _finite(found.held_out[0].error),
            "explained_after_pushes": _finite(found.held_out[1].explained),
            "modes": [
                {
                    **one._asdict(),
                    "foretold": asdict(mode),
                    "sigma_off": mode.sigma - one.sigma,
                    "omega_off": mode.omega / one.omega - 1.0,
                }
                for one, mode in found.held_out_modes
            ],
        },
    }


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def as_text(found: Identified) -> str:
    """Return the result as aligned text."""
    data = as_data(found)
    lines = []
    for log in data["logs"]:
        law = log["law"]
        said = f"{log['seconds']:.0f} s at {log['rate']:.0f} Hz"
        if law is not None:
            said += f", torque ({law['constant']:.2f} {law['per_speed']:+.2f} v) x lean rate"
        lines.append(f"{log['name']}: {said}")
    lines.append(f"fitted to {data['fitted_to']}")
    if data["misfit"] is not None:
        rate, angle = data["misfit"]
        lines.append(
            f"left: {rate:.2f} of the lean rate's noise, {angle:.2f} of the steer angle's"
        )
        if max(rate, angle) > 1.5:
            lines.append(
                "more than noise: disturbances, friction, or another delay than the file's"
            )
    lines += ["", f"{'':8} {'found':>10} {'±':>10} {'before':>10} {'±':>10}"]
    for name, row in data["parameters"].items():
        mark = "" if row["determined"] else "  not determined"
        lines.append(
            f"{name:8} {row['value']:10.5g} {row['standard_error']:10.2g} {row['before']:10.5g} "
            f"{row['before_deviation']:10.2g}{mark}"
        )
    known = data["determined_combinations"]
    lines += ["", f"the ride determines {known['count']} combinations of {known['of']} numbers:"]
    for one in known["largest"][:8]:
        lines.append("  " + " ".join(f"{value:+.2f} {name}" for name, value in one.items()))
    lines += ["", "weave, 1/s and rad/s"]
    lines += [f"  {_mode(mode)}" for mode in found.modes]
    for one in found.measured:
        lines.append(
            f"  {one.speed:5.2f} m/s after {one.pushes} pushes: {one.sigma:.2f} ± "
            f"{one.sigma_error:.2f}, {one.omega:.2f} ± {one.omega_error:.2f}"
        )
    lines += ["", f"held out: {', '.join(found.held_out_names)}"]
    every, after = found.held_out
    if every.predictions:
        lines.append(
            f"  lean rate 0.5 s ahead, any moment: {100 * every.explained:.1f} % explained"
        )
    if after.predictions:
        lines.append(f"  lean rate in 0.5 s after a push: {100 * after.explained:.1f} % explained")
    for seen, mode in found.held_out_modes:
        lines.append(
            f"  {seen.speed:.2f} m/s: foretold {mode.sigma:.2f}, {mode.omega:.2f}; measured "
            f"{seen.sigma:.2f}, {seen.omega:.2f} ({seen.pushes} pushes); off by "
            f"{mode.sigma - seen.sigma:+.2f} 1/s and {100 * (mode.omega / seen.omega - 1):+.1f} %"
        )
    return "\n".join(lines)


def _mode(mode: Mode) -> str:
    under = f"torque {mode.gain:.2f} x lean rate" if mode.gain else "handlebar free"
    return (
        f"{mode.speed:5.2f} m/s, {under}: {mode.sigma:.3f} ± {mode.sigma_error:.2g}, "
        f"{mode.omega:.3f} ± {mode.omega_error:.2g}"
    )


def as_yaml(found: Identified, name: str) -> str:
    """Return the bicycle's file, as `--bicycle` takes it."""
    p = found.parameters
    errors = found.errors()
    values = {key: float(value) for key, value in asdict(p.bicycle).items()}
    content: dict[str, Any] = {
        "name": name,
        "about": f"identified from {', '.join(log.name for log in found.logs)}",
        "bicycle": values,
        "standard_deviation": {key: errors[key] for key in errors if key in values},
    }
    for key, part in (("steering", p.steering), ("motor", p.motor)):
        content[key] = {k: float(v) for k, v in asdict(part).items()}
    content["delay"] = float(p.delay)
    return yaml_text.dump(content)


def write(found: Identified, path: Path) -> None:
    """Write the bicycle's file.

    Raises:
        OSError: if it cannot be written.
    """
    path.write_text(as_yaml(found, path.stem))
