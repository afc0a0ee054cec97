"""Weave modes of the model beside those that were measured on real, riderless bicycles."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bicycle_sim.plants import registry

DATA = Path(__file__).parents[1] / "data" / "real_bicycles"
NAMES = ("lean_angle", "lean_rate", "steer_angle", "steer_rate")


def weave(bicycle: str, speed: float, gain: float) -> complex:
    """Fastest oscillating mode under a steer torque of `gain` times the lean rate."""
    model = registry.named("whipple", bicycle).linearize(speed)
    rows = [model.states.index(name) for name in NAMES]
    a = model.a.copy()
    a[:, rows[1]] += gain * model.b[:, 0]
    found = np.linalg.eigvals(a[np.ix_(rows, rows)])
    return complex(found[found.imag.argmax()])


@pytest.mark.parametrize("speed", [2.0, 3.0, 4.0, 5.0])
def test_the_steer_by_wire_bicycle_weaves_as_measured(speed: float) -> None:
    """The model has the measured parameters and the logged law, 2 (6.5 - v) times the lean rate.

    The bicycle computes its law from its own wheel's speed, which reads 2 to 4 % more than the
    treadmill; the logs hold both, the torque that was commanded and the treadmill's speed.
    """
    rows = json.loads((DATA / "sbw_weave_modes.json").read_text())[f"{speed:.1f}"]
    real, imaginary = np.array(rows)[:, :2].mean(axis=0)
    logged = float(np.array(rows)[:, 3].mean())
    found = weave("steer-by-wire", speed, 2.0 * (6.5 - logged))
    assert found.real == pytest.approx(real, abs=0.25)
    assert found.imag == pytest.approx(imaginary, rel=0.16)


@pytest.mark.parametrize(("gain", "kappa"), [(8, 3.9), (10, 5.2)])
def test_the_balance_assist_e_bike_weaves_as_measured(gain: int, kappa: float) -> None:
    """The law is kappa (4.7 - v) times the lean rate; near its zero the model is too fast."""
    file = DATA / f"balance_assist_weave_eigenvalues_from_experiment_gain_{gain}.csv"
    for speed, real, imaginary in np.loadtxt(file, delimiter=",", skiprows=1):
        if speed != 4.44:
            found = weave("balance-assist", speed, kappa * (4.7 - speed))
            assert found.imag == pytest.approx(imaginary, rel=0.11)
            if 2.5 < speed < 4.0:
                assert found.real == pytest.approx(real, abs=0.25)
