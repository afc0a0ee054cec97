"""Dynamics of many bicycles as tensors, on any device of torch."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import torch

from bicycle_sim.plants.choi import dynamics
from bicycle_sim.plants.choi.dynamics import State
from bicycle_sim.plants.choi.parameters import Physics

_NAMES = tuple(field.name for field in fields(State))


class TensorDynamics:
    """`dynamics.step` on a device: one copy there and one back, for any number of bicycles.

    Starts, goals and rewards stay with the task, in numpy.
    """

    def __init__(self, device: torch.device | str) -> None:
        """Step on `device`."""
        self.device = torch.device(device)

    def __call__(
        self,
        state: State,
        torque: np.ndarray,
        displacement: np.ndarray,
        pedal_force: np.ndarray,
        physics: Physics,
        speed_limits: tuple[float, float] | None = None,
    ) -> State:
        """Step as `dynamics.step` does, with arrays of shape (N,) in and out."""
        rows = [getattr(state, name) for name in _NAMES]
        there = torch.from_numpy(np.stack([*rows, torque, displacement, pedal_force]))
        *values, torque_, displacement_, pedal_force_ = there.to(self.device)
        moved = dynamics.step(
            State(**dict(zip(_NAMES, values, strict=True))),
            torque_,
            displacement_,
            pedal_force_,
            physics,
            speed_limits,
            torch,
        )
        back = torch.stack([getattr(moved, name) for name in _NAMES]).cpu().numpy()
        return State(**dict(zip(_NAMES, back, strict=True)))
