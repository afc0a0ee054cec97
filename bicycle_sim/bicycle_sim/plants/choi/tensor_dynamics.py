"""The paper's bicycles stepped as tensors, on any device of torch."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import torch

from bicycle_sim.plants.base import Array, BodyState
from bicycle_sim.plants.choi import dynamics
from bicycle_sim.plants.choi.parameters import Physics

_NAMES = tuple(field.name for field in fields(BodyState))


def step(
    device: str,
    physics: Physics,
    state: BodyState,
    inputs: tuple[np.ndarray, np.ndarray, np.ndarray],
    speed_limits: tuple[Array, Array] | None = None,
) -> BodyState:
    """Step as `dynamics.step` does: one copy to the device and one back, for N bicycles.

    Args:
        device: torch's name of the device.
        physics: constants and corrections.
        state: the bicycles; not changed.
        inputs: (N,) torque in N m, displacement in m, pedal force in N.
        speed_limits: bounds of the speed, m/s, or None.

    Returns:
        The state one time step later, arrays (N,) of numpy.
    """
    rows = [getattr(state, name) for name in _NAMES]
    there = torch.from_numpy(np.stack([*rows, *inputs]))
    *values, torque, displacement, pedal_force = there.to(torch.device(device))
    moved = dynamics.step(
        BodyState(**dict(zip(_NAMES, values, strict=True))),
        torque,
        displacement,
        pedal_force,
        physics,
        speed_limits,
        torch,
    )
    back = torch.stack([getattr(moved, name) for name in _NAMES]).cpu().numpy()
    return BodyState(**dict(zip(_NAMES, back, strict=True)))
