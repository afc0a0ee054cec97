"""Recoverable lean of a bicycle, from its unstable mode and its torque limit.

Of a linear plant with one unstable mode z, which grows by the factor mu in a control period, no
command u within its limit brings z back from beyond sum |mu^-k w b u|: each period's push counts
the less the later it comes. For a pair of modes that oscillates, the same sum over the part of
each push that acts against it gives a convex region in the complex plane, and the largest circle
in it is taken.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bicycle_sim.plants.base import Linear

GAINED = 1e-4
"""Share of the first period's push below which later ones are left out."""
LONGEST = 20_000
"""Control periods that are looked at, at most."""
DIRECTIONS = np.linspace(0.0, np.pi, 64, endpoint=False)
"""rad, of the complex plane."""


class UnstableMode(NamedTuple):
    """The fastest growing mode of a discrete plant, with 1 for the lean."""

    vector: np.ndarray
    """(n,) complex left eigenvector, over the model's states."""
    factor: complex
    """Growth in one control period (mu)."""


def unstable_mode(model: Linear) -> UnstableMode:
    """Return the mode of the largest eigenvalue of a discrete model, heading left out."""
    rows = [index for index, name in enumerate(model.states) if name != "heading_error"]
    values, vectors = np.linalg.eig(model.a[np.ix_(rows, rows)].T)
    chosen = np.abs(values).argmax()
    vector = np.zeros(len(model.states), dtype=np.complex128)
    lean = rows.index(model.states.index("lean_angle"))
    vector[rows] = vectors[:, chosen] / vectors[lean, chosen]
    return UnstableMode(vector, complex(values[chosen]))


def farthest(model: Linear, torque_limit: float) -> float:
    """Return the extrapolated lean from which a steer torque can bring the bicycle back, rad.

    Args:
        model: discrete, with delay and motor where the plant has them.
        torque_limit: N m.

    Returns:
        Infinite where the bicycle balances itself.
    """
    mode = unstable_mode(model)
    growth = abs(mode.factor)
    if growth <= 1.0 + 1e-9:
        return float("inf")
    push = torque_limit * (mode.vector @ model.b[:, model.inputs.index("torque")])
    periods = min(LONGEST, int(np.ceil(np.log(GAINED) / -np.log(growth))))
    pushes = push * mode.factor ** -(1.0 + np.arange(periods))
    against = np.abs((np.exp(-1j * DIRECTIONS)[:, None] * pushes).real).sum(axis=1)
    # A real mode has pushes along the real axis only.
    real = abs(mode.factor.imag) < 1e-12
    return float(np.abs(pushes).sum() if real else against.min())


def within_steering(model: Linear) -> float:
    """Return how far the extrapolated lean may be for every rad that the handlebar can be turned.

    A lean that no turn of the handlebar can catch grows whatever the torque. Steering acts as it
    stands, which turns the bicycle, and as it moves, which swings the front under the mass.

    Args:
        model: continuous.

    Returns:
        rad of extrapolated lean per rad of steering.
    """
    row = dict(zip(model.states, model.a[model.states.index("lean_rate")], strict=True))
    growth = float(
        np.roots([1.0, -row["lean_rate"], -row["lean_angle"]]).real.max()  # of a fixed handlebar
    )
    return abs(row["steer_angle"] + growth * row["steer_rate"]) / abs(row["lean_angle"])
