"""The paper's bicycle as a plant: `bicycle_sim.plants.choi.dynamics`, to the bit."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, cast

import numpy as np

from bicycle_sim.plants.base import Array, BodyState, Geometry, Linear, Loads, Plant
from bicycle_sim.plants.choi import dynamics
from bicycle_sim.plants.choi.linear import (
    INPUT_FIELDS,
    STATE_FIELDS,
    continuous,
    discrete,
    steady_lean,
)
from bicycle_sim.plants.choi.parameters import Physics


class ChoiPlant(Plant[BodyState]):
    """N of the paper's bicycles, all alike."""

    name = "choi"
    state_type = BodyState

    def __init__(self, physics: Physics | None = None) -> None:
        """Ride with these constants and corrections; faithful by default."""
        self.physics = physics or Physics()

    @property
    def time_step(self) -> float:
        """s of one control period."""
        return self.physics.constants.time_step

    @property
    def count(self) -> int | None:
        """None: all are alike."""
        return None

    @property
    def input_names(self) -> tuple[str, ...]:
        """All three."""
        return "torque", "displacement", "pedal_force"

    @property
    def geometry(self) -> Geometry:
        """As far as the paper has one: no trail, an upright steering axis."""
        k = self.physics.constants
        return Geometry(
            wheelbase=k.wheelbase,
            trail=0.0,
            steer_axis_tilt=0.0,
            rear_radius=k.tyre_radius,
            front_radius=k.tyre_radius,
            mass=k.mass,
            mass_forward=k.wheelbase - k.front_to_mass,
            mass_height=k.mass_height,
        )

    def initial(
        self, rear_x: np.ndarray, rear_y: np.ndarray, heading: np.ndarray, speed: np.ndarray
    ) -> BodyState:
        """N upright bicycles with straight handlebars; arguments of shape (N,), m, rad, m/s."""
        state = dynamics.upright(rear_x, rear_y, heading, speed, self.physics.constants)
        return BodyState(**vars(state))

    def step(
        self,
        state: BodyState,
        torque: np.ndarray,
        displacement: np.ndarray,
        pedal_force: np.ndarray,
        speed_limits: tuple[Array, Array] | None = None,
        loads: Loads | None = None,
    ) -> BodyState:
        """One control period; see `Plant.step`.

        Raises:
            ValueError: on loads, which the paper's equations have no place for.
        """
        if loads is not None:
            raise ValueError("the paper's bicycle takes no loads: choose the plant whipple")
        moved = dynamics.step(
            cast(dynamics.State, state),
            torque,
            displacement,
            pedal_force,
            self.physics,
            speed_limits,
        )
        return cast(BodyState, moved)

    def pushed(self, state: BodyState, lean_rate: Array) -> BodyState:
        """The state after a push that adds `lean_rate`, rad/s, float or (N,)."""
        return BodyState(**{**vars(state), "lean_rate": state.lean_rate + lean_rate})

    def fallen(self, state: BodyState, limit: float) -> np.ndarray:
        """(N,) bool: leans by more than `limit`, rad."""
        lies: np.ndarray = dynamics.fallen(state.lean_angle, limit)
        return lies

    def linearize(self, speed: float, discrete: bool = False) -> Linear:
        """About riding straight at a speed, m/s; see `bicycle_sim.plants.choi.linear`."""
        a, b = _MODELS[discrete](speed, self.physics)
        return Linear(STATE_FIELDS, INPUT_FIELDS, a, b, self.time_step if discrete else None)

    def steady_lean(self, steer_angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """(N,) rad at which a steady turn is balanced; arguments of shape (N,), rad and m/s."""
        lean: np.ndarray = steady_lean(steer_angle, speed, self.physics.constants)
        return lean

    def take(self, mask: np.ndarray) -> ChoiPlant:
        """Itself: all bicycles are alike."""
        return self

    def to_json(self) -> str:
        """All parameters to the last bit, with the key `plant`."""
        return json.dumps({"plant": self.name, **asdict(self.physics)})

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> ChoiPlant:
        """What `to_json` wrote, as plain data, with or without `plant`.

        Raises:
            ValueError: on an unknown key, or on a value that makes no sense.
        """
        values = {key: value for key, value in data.items() if key != "plant"}
        return cls(Physics.from_json(json.dumps(values)))


_MODELS = {False: continuous, True: discrete}
