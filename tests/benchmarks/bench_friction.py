"""Coulomb friction of a steering from ring-downs after pushes, and whether it explains the misses.

Friction takes F * integral |steer rate| of energy in a ring-down, where a damper takes
c * integral (steer rate)^2; so it acts as a damper of F * mean |rate| / mean rate^2, more the
weaker the push. F is fitted beside the numbers that `bicycle identify` fits, to the modes of each
log's ring-downs in groups from strong to weak. Writes `docs/results/identify/friction.json`.

    python tests/benchmarks/bench_friction.py
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from machine import machine
from scipy.optimize import least_squares

from bicycle_controller.identification import read_csv
from bicycle_controller.identification.logs import Array, resampled
from bicycle_controller.identification.ride_model import matrices, weave
from bicycle_controller.identification.ringdown import SECONDS, ringdowns
from bicycle_controller.identification.unknowns import Unknowns, unknowns
from bicycle_sim.plants.whipple import catalogue
from bicycle_sim.plants.whipple.parameters import Parameters

ROOT = Path(__file__).parents[2]
DATA = ROOT / "tests" / "data" / "real_bicycles"
OUT = ROOT / "docs" / "results" / "identify" / "friction.json"
FITTED = ("sbw_7.2kph.csv.gz", "sbw_14.4kph.csv.gz", "sbw_18kph.csv.gz")
HELD_OUT = "sbw_10.8kph_impulses.csv.gz"
BEFORE = 0.3
"""N m, prior deviation of the friction."""
GROUP = 4
"""Ring-downs that a group has at least."""


class Group(NamedTuple):
    """Ring-downs of like strength: medians with standard errors."""

    speed: float
    sigma: float
    sigma_error: float
    omega: float
    omega_error: float
    sticking: float
    """s/rad, mean |steer rate| / mean steer rate^2."""


def law(speed: float) -> float:
    """Return the bicycle's own law, N m per rad/s of lean rate."""
    return 2.0 * (6.5 - speed)


def seen(name: str) -> Array:
    """Return (n, 4) speed, sigma, omega and sticking of each ring-down."""
    rows = []
    (log,) = read_csv.read(DATA / name, 100.0)
    log = resampled(log)
    for one in ringdowns(log):
        piece = log.pieces[one.piece]
        angle, half = piece.steer_angle, 2
        rate = np.zeros(len(angle))
        rate[half:-half] = (angle[2 * half :] - angle[: -2 * half]) / (2 * half * piece.dt)
        rate = rate[one.start : one.start + round(SECONDS / piece.dt)]
        rows.append((one.speed, one.sigma, one.omega, np.abs(rate).mean() / (rate**2).mean()))
    return np.array(rows)


def grouped(rows: Array, most: int) -> list[Group]:
    """Return at most `most` groups from strong to weak pushes."""
    parts = np.array_split(rows[np.argsort(rows[:, 3])], max(1, min(most, len(rows) // GROUP)))

    def error(values: Array, least: float) -> float:
        spread = 1.4826 * float(np.median(np.abs(values - np.median(values))))
        return max(1.25 * spread / float(np.sqrt(len(values))), least)

    return [
        Group(
            float(part[:, 0].mean()),
            float(np.median(part[:, 1])),
            error(part[:, 1], 0.1),
            float(np.median(part[:, 2])),
            error(part[:, 2], 0.02 * float(np.median(part[:, 2]))),
            float(np.median(part[:, 3])),
        )
        for part in parts
    ]


def mode(p: Parameters, friction: float, speed: float, sticking: float) -> complex:
    """Return the weave under the law with the friction's equivalent damper."""
    damping = p.steering.damping + friction * sticking
    q = replace(p, steering=replace(p.steering, damping=damping))
    return weave(q, matrices(q), speed, law(speed))


def fitted(unknown: Unknowns, groups: list[Group], free: bool) -> tuple[Parameters, float, float]:
    """Return the bicycle, its friction and that one's standard error, N m."""
    count = len(unknown.names)

    def residual(x: Array) -> Array:
        p, friction = unknown.parameters(x[:count]), BEFORE * max(0.0, x[count]) if free else 0.0
        rows = []
        for one in groups:
            found = mode(p, friction, one.speed, one.sticking)
            rows.append((found.real - one.sigma) / one.sigma_error)
            rows.append((found.imag - one.omega) / one.omega_error)
        return np.concatenate([rows, x])

    start = np.zeros(count + 1)
    start[count] = 0.5 if free else 0.0
    found = least_squares(residual, start, max_nfev=200)
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    x = found.x
    error = BEFORE * float(np.sqrt(covariance[count, count])) if free else 0.0
    friction = BEFORE * max(0.0, float(x[count])) if free else 0.0
    return unknown.parameters(x[:count]), friction, error


def main() -> None:
    """Fit with and without friction, and compare with each speed's impulses."""
    rings = {name: seen(name) for name in (*FITTED, HELD_OUT)}
    told = json.loads((DATA / "sbw_weave_modes.json").read_text())
    unknown = unknowns(catalogue.load("steer-by-wire").parameters, 1.0, ("damping",))
    # The slowest log's pushes stand in at 1.5 m/s, of which only the modes are kept.
    of = {"1.5": FITTED[0], "2.0": FITTED[0], "3.0": HELD_OUT, "4.0": FITTED[1], "5.0": FITTED[2]}
    rows = []
    for label, free, most in (("none", False, 1), ("fitted", True, 2), ("fitted", True, 3)):
        groups = [group for name in FITTED for group in grouped(rings[name], most)]
        p, friction, error = fitted(unknown, groups, free)
        at = {}
        for speed, name in of.items():
            sigma, omega = np.array(told[speed])[:, :2].mean(axis=0)
            found = mode(p, friction, float(speed), float(np.median(rings[name][:, 3])))
            at[speed] = {
                "measured": [round(float(sigma), 2), round(float(omega), 2)],
                "found": [round(found.real, 2), round(found.imag, 2)],
                "frequency off by (%)": round(100.0 * (found.imag / float(omega) - 1.0), 1),
                "damping off by (1/s)": round(found.real - float(sigma), 2),
            }
        rows.append(
            {
                "friction": label,
                "groups of each log": most,
                "friction (N m)": round(friction, 3),
                "standard error (N m)": round(error, 3),
                "damping (N m s/rad)": round(float(p.steering.damping), 3),
                "at (m/s)": at,
            }
        )
    result = {"command": ["python", *sys.argv], "machine": machine("numpy"), "rows": rows}
    OUT.parent.mkdir(parents=True, exist_ok=True)
    OUT.write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
