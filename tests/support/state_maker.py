"""States for tests: bicycles by the paper's symbols, as arrays or tensors."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
from reference_bicycle import Bicycle

from bicycle_sim.plants.choi.dynamics import State, upright
from bicycle_sim.plants.choi.parameters import Constants

SYMBOLS = {
    "lean_angle": "omega",
    "lean_rate": "omega_dot",
    "lean_acceleration": "omega_dot_dot",
    "steer_angle": "theta",
    "steer_rate": "theta_dot",
    "heading": "psi",
    "front_x": "x_f",
    "front_y": "y_f",
    "rear_x": "x_b",
    "rear_y": "y_b",
    "speed": "v",
}


def state_of(*bicycles: Bicycle, xp: ModuleType = np) -> State:
    """Return the same bicycles as the simulator's state."""
    columns = {
        name: [getattr(bicycle, symbol) for bicycle in bicycles]
        for name, symbol in SYMBOLS.items()
    }
    make = xp.array if xp is np else xp.tensor
    return State(**{name: make(values, dtype=xp.float64) for name, values in columns.items()})


def riding(heading: Any = 0.0, speed: float = 10.0 / 3.6, count: int = 1, **values: Any) -> State:
    """Return `count` bicycles with the rear contact at the origin; `values` replaces fields."""
    zero = np.zeros(count)
    state = upright(zero, zero, zero + heading, zero + speed, Constants())
    for name, value in values.items():
        setattr(state, name, zero + value)
    return state


def rows(state: State) -> np.ndarray:
    """Return all fields, (11, N)."""
    return np.stack([np.asarray(getattr(state, name)) for name in SYMBOLS])
