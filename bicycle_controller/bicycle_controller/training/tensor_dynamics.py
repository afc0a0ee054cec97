"""The paper's bicycles as tensors, on any device of torch."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import torch

from bicycle_sim.plants.base import Array, BodyState, Loads, Plant
from bicycle_sim.plants.choi import dynamics
from bicycle_sim.plants.choi.parameters import Physics
from bicycle_sim.plants.choi.plant import ChoiPlant

_NAMES = tuple(field.name for field in fields(BodyState))


class TensorDynamics(ChoiPlant):
    """`dynamics.step` on a device: one copy there and one back, for any number of bicycles.

    Starts, goals and rewards stay with the task, in numpy.
    """

    def __init__(self, physics: Physics | None, device: torch.device | str) -> None:
        """Step on `device`; faithful physics by default."""
        super().__init__(physics)
        self.device = torch.device(device)

    @classmethod
    def of(cls, plant: Plant[Any], device: torch.device | str) -> TensorDynamics:
        """Return the same bicycle on a device.

        Raises:
            ValueError: when it is not the paper's.
        """
        if not isinstance(plant, ChoiPlant):
            raise ValueError(f"{plant.label} is stepped on the processor only: use device=cpu")
        return cls(plant.physics, device)

    def step(
        self,
        state: BodyState,
        torque: np.ndarray,
        displacement: np.ndarray,
        pedal_force: np.ndarray,
        speed_limits: tuple[Array, Array] | None = None,
        loads: Loads | None = None,
    ) -> BodyState:
        """Step as `ChoiPlant.step` does, with arrays of shape (N,) in and out."""
        if loads is not None:
            return super().step(state, torque, displacement, pedal_force, speed_limits, loads)
        rows = [getattr(state, name) for name in _NAMES]
        there = torch.from_numpy(np.stack([*rows, torque, displacement, pedal_force]))
        *values, torque_, displacement_, pedal_force_ = there.to(self.device)
        moved = dynamics.step(
            BodyState(**dict(zip(_NAMES, values, strict=True))),
            torque_,
            displacement_,
            pedal_force_,
            self.physics,
            speed_limits,
            torch,
        )
        back = torch.stack([getattr(moved, name) for name in _NAMES]).cpu().numpy()
        return BodyState(**dict(zip(_NAMES, back, strict=True)))
