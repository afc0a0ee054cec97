"""Weave of the model beside that of real, riderless bicycles: `docs/results/bicycles/weave.json`.

    python tests/benchmarks/bench_weave.py

The measured modes are in `tests/data/real_bicycles`. A steer torque follows the lean rate by the
law that the bicycle had. The steer-by-wire bicycle's law takes its own wheel's speed, which reads
more than the treadmill's. Beside the measured numbers stand those that `bicycle identify` makes
of the logs at 7.2, 14.4 and 18 km/h.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from bicycle_common.origin import made_by
from bicycle_controller.identification import read_csv, report
from bicycle_controller.identification.identify import identify
from bicycle_controller.identification.ride_model import matrices, weave
from bicycle_sim.plants import registry
from bicycle_sim.plants.whipple import catalogue

ROOT = Path(__file__).parents[2]
DATA = ROOT / "tests" / "data" / "real_bicycles"
OUT = ROOT / "docs" / "results" / "bicycles" / "weave.json"
NAMES = ("lean_angle", "lean_rate", "steer_angle", "steer_rate")


def modes(bicycle: str, speed: float, gain: float) -> list[list[float]]:
    """Return the oscillations, 1/s and rad/s, under a steer torque of `gain` x the lean rate."""
    model = registry.named("whipple", bicycle).linearize(speed)
    rows = [model.states.index(name) for name in NAMES]
    a = model.a.copy()
    a[:, rows[1]] += gain * model.b[:, 0]
    found = np.linalg.eigvals(a[np.ix_(rows, rows)])
    fastest = sorted((one for one in found if one.imag > 0.0), key=lambda one: -float(one.imag))
    return [[round(float(one.real), 3), round(float(one.imag), 3)] for one in fastest]


def steer_by_wire() -> list[dict[str, Any]]:
    """Return rows by the treadmill's speed; the law is 2 (6.5 - v)."""
    rows = []
    for text, impulses in json.loads((DATA / "sbw_weave_modes.json").read_text()).items():
        values, treadmill = np.array(impulses), float(text)
        wheel = float(values[:, 3].mean())
        speeds = {
            "law as logged": (treadmill, wheel),
            "the wheel's speed for both": (wheel, wheel),
            "the treadmill's for both": (treadmill, treadmill),
        }
        rows.append(
            {
                "treadmill (m/s)": treadmill,
                "wheel (m/s)": round(wheel, 3),
                "impulses": len(values),
                "measured": [round(float(one), 3) for one in values[:, :2].mean(axis=0)],
                "model": {
                    name: modes("steer-by-wire", moves, 2.0 * (6.5 - told))
                    for name, (moves, told) in speeds.items()
                },
            }
        )
    return rows


def balance_assist(gain: int, kappa: float) -> list[dict[str, Any]]:
    """Return rows by speed; the law is kappa (4.7 - v)."""
    file = DATA / f"balance_assist_weave_eigenvalues_from_experiment_gain_{gain}.csv"
    return [
        {
            "speed (m/s)": speed,
            "measured": [real, imaginary],
            "model": modes("balance-assist", speed, kappa * (4.7 - speed)),
            "model, no torque": modes("balance-assist", speed, 0.0),
        }
        for speed, real, imaginary in np.loadtxt(file, delimiter=",", skiprows=1).tolist()
    ]


def identified() -> dict[str, Any]:
    """Return what `bicycle identify` finds, and its modes at the treadmill's speeds."""
    prior = catalogue.load("steer-by-wire").parameters
    logs = [
        log
        for speed in ("7.2", "14.4", "18")
        for log in read_csv.read(DATA / f"sbw_{speed}kph.csv.gz", 100.0)
    ]
    held_out = read_csv.read(DATA / "sbw_10.8kph_impulses.csv.gz", 100.0)
    with np.errstate(all="ignore"):
        result = identify(logs, prior, 1.0, held_out)
    data, rows = report.as_data(result), []
    for text, impulses in json.loads((DATA / "sbw_weave_modes.json").read_text()).items():
        speed, (real, imaginary) = float(text), np.array(impulses)[:, :2].mean(axis=0)
        row: dict[str, Any] = {"treadmill (m/s)": speed}
        for name, known in (("measured numbers", prior), ("identified", result.parameters)):
            mode = weave(known, matrices(known), speed, 2.0 * (6.5 - speed))
            row[name] = {
                "frequency off by (%)": round(100.0 * (mode.imag / float(imaginary) - 1.0), 1),
                "damping off by (1/s)": round(mode.real - float(real), 2),
            }
        rows.append(row)
    kept = ("fitted_to", "determined_combinations", "held_out")
    return {"modes": rows, **{name: data[name] for name in kept}}


def main() -> None:
    """Compute, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=OUT)
    given = parser.parse_args()
    result = {
        **made_by(),
        "modes": "real part (1/s), frequency (rad/s), the fastest first",
        "steer-by-wire": steer_by_wire(),
        "balance-assist, gain 10, kappa 5.2": balance_assist(10, 5.2),
        "balance-assist, gain 8, kappa 3.9": balance_assist(8, 3.9),
        "steer-by-wire, identified": identified(),
    }
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text(json.dumps(result, indent=1) + "\n")
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
