"""Two plants of one kind in one task, such as the paper's in faithful and in corrected physics.

An actor that is trained on both learns to ride both.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bicycle_sim.plants import base
from bicycle_sim.plants.base import Array, BodyState, Geometry, Linear, Loads, Plant


class MixedPlant(Plant[BodyState]):
    """N bicycles, each of one of two plants.

    Geometry, linear model and parameters are those of the first plant.
    """

    name = "mixed"

    def __init__(self, first: Plant[Any], second: Plant[Any], is_second: np.ndarray) -> None:
        """Mix them.

        Args:
            first: one plant, of bicycles that are alike.
            second: the other one.
            is_second: bool (N,).

        Raises:
            ValueError: if the two are of different kinds or inputs, or of different bicycles.
        """
        alike = type(first) is type(second) and first.input_names == second.input_names
        if not alike or first.count is not None or second.count is not None:
            raise ValueError("only two plants of one kind, each of bicycles that are alike, mix")
        if first.time_step != second.time_step:
            raise ValueError("plants of different control periods do not mix")
        self.first, self.second, self.is_second = first, second, is_second
        self.state_type = first.state_type  # type: ignore[misc]

    @property
    def time_step(self) -> float:
        """Duration of one control period, s."""
        return self.first.time_step

    @property
    def count(self) -> int | None:
        """Number of bicycles."""
        return len(self.is_second)

    @property
    def input_names(self) -> tuple[str, ...]:
        """Inputs that both plants have."""
        return self.first.input_names

    @property
    def label(self) -> str:
        """Labels of both plants."""
        return f"{self.first.label} and {self.second.label}"

    @property
    def geometry(self) -> Geometry:
        """Geometry of the first plant."""
        return self.first.geometry

    @property
    def displacement_noise(self) -> float:
        """Displacement noise of the first plant."""
        return self.first.displacement_noise

    def initial(
        self, rear_x: np.ndarray, rear_y: np.ndarray, heading: np.ndarray, speed: np.ndarray
    ) -> BodyState:
        """Return N upright bicycles; see `Plant.initial`."""
        state: BodyState = self.first.initial(rear_x, rear_y, heading, speed)
        return state

    def step(
        self,
        state: BodyState,
        torque: np.ndarray,
        displacement: np.ndarray,
        pedal_force: np.ndarray,
        speed_limits: tuple[Array, Array] | None = None,
        loads: Loads | None = None,
    ) -> BodyState:
        """Simulate one control period; see `Plant.step`.

        Raises:
            ValueError: on loads: they are not divided.
        """
        if loads is not None:
            raise ValueError("two plants in one task take no loads")
        moved = base.copy(state)
        for plant, mask in ((self.first, ~self.is_second), (self.second, self.is_second)):
            rows = np.flatnonzero(mask)
            if not len(rows):
                continue
            actions = torque[rows], displacement[rows], pedal_force[rows]
            part = plant.step(base.take(state, rows), *actions, speed_limits)
            moved = base.put(moved, rows, part)
        return moved

    def pushed(self, state: BodyState, lean_rate: Array) -> BodyState:
        """Return the state after a push; see `Plant.pushed`."""
        pushed: BodyState = self.first.pushed(state, lean_rate)
        return pushed

    def settled(self, state: BodyState) -> BodyState:
        """Return the state with all that follows from it; see `Plant.settled`."""
        settled: BodyState = self.first.settled(state)
        return settled

    def yaw_rate(self, state: BodyState) -> np.ndarray:
        """Return (N,) rad/s."""
        return np.where(self.is_second, self.second.yaw_rate(state), self.first.yaw_rate(state))

    def fallen(self, state: BodyState, limit: float) -> np.ndarray:
        """Return (N,) bool; see `Plant.fallen`."""
        return self.first.fallen(state, limit)

    def linearize(self, speed: float, discrete: bool = False) -> Linear:
        """Linearise the first plant."""
        return self.first.linearize(speed, discrete)

    def steady_lean(self, steer_angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return the first plant's steady lean."""
        return self.first.steady_lean(steer_angle, speed)

    def take(self, mask: np.ndarray) -> MixedPlant:
        """Return the plant of the bicycles that `mask` (N,) selects."""
        return MixedPlant(self.first, self.second, self.is_second[mask])

    def to_json(self) -> str:
        """Return the first's parameters."""
        return self.first.to_json()

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> MixedPlant:
        """Refuse: it is made from two plants.

        Raises:
            ValueError: always.
        """
        raise ValueError("a mixed plant is made from two others")
