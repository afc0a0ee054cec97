"""The paper's bicycle as a plant: `bicycle_sim.plants.choi.dynamics`, to the bit."""

from __future__ import annotations

import ctypes
import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from bicycle_sim.plants.base import Array, BodyState, Geometry, Linear, Loads, Plant
from bicycle_sim.plants.choi import compiled, dynamics
from bicycle_sim.plants.choi.linear import (
    INPUT_FIELDS,
    STATE_FIELDS,
    continuous,
    discrete,
    steady_lean,
)
from bicycle_sim.plants.choi.parameters import MODES, Physics


class ChoiPlant(Plant[BodyState]):
    """N bicycles of the paper, all alike."""

    name = "choi"
    about = "the paper's bicycle"
    takes_displacement_noise = True
    state_type = BodyState
    body_is_all = True
    fits_named_tunings = True
    safety_envelope = (
        (1.0, 1.5, 2.0, 2.5, 2.75, 3.5, 5.0),
        (0.12, 0.17, 0.25, 0.38, 0.46, 0.50, 0.50),
    )
    """At every speed between the largest value in ordinary rides of the shipped actors and the
    largest from which the LQR recovers (`tests/benchmarks/bench_safety.py`)."""

    def __init__(self, physics: Physics | None = None, device: str | None = None) -> None:
        """Use these constants and corrections; faithful by default.

        Args:
            physics: constants and corrections.
            device: torch's name of the device that steps the bicycles; None for numpy. Starts,
                goals and rewards stay with the task, in numpy.
        """
        self.physics = physics or Physics()
        self.device = device

    @classmethod
    def named(cls, mode: str) -> ChoiPlant:
        """Return the plant of faithful or corrected physics, see `Physics.named`."""
        return cls(Physics.named(mode))

    @property
    def time_step(self) -> float:
        """Duration of one control period, s."""
        return self.physics.constants.time_step

    @property
    def count(self) -> int | None:
        """None: all bicycles are alike."""
        return None

    @property
    def input_names(self) -> tuple[str, ...]:
        """All three inputs."""
        return "torque", "displacement", "pedal_force"

    @property
    def label(self) -> str:
        """`faithful`, `corrected`, or what differs from faithful."""
        for name in MODES:
            if self.physics == Physics.named(name):
                return name
        plain, own = asdict(Physics()), asdict(self.physics)
        return ", ".join(f"{name} {value}" for name, value in own.items() if value != plain[name])

    @property
    def geometry(self) -> Geometry:
        """Geometry as far as the paper gives it: no trail, a vertical steering axis."""
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
            rider_height=k.mass_height + k.rider_above_mass,
            steer_stop=k.steer_stop,
            crank_ratio=k.sprocket / k.chain_wheel,
        )

    @property
    def displacement_noise(self) -> float:
        """m (errata row 21)."""
        return self.physics.displacement_noise

    def with_displacement_noise(self, spread: float) -> ChoiPlant:
        """Return the plant whose noise is `spread`, m."""
        return type(self)(replace(self.physics, displacement_noise=spread), self.device)

    @property
    def pedal_gear(self) -> float:
        """Force at the rear wheel's rim per pedal force (eq. 11)."""
        return self.physics.constants.pedal_gain

    def on_device(self, device: str) -> ChoiPlant:
        """Return the plant that torch steps on `device`."""
        return type(self)(self.physics, device)

    @property
    def compiled_numbers(self) -> ctypes.Structure | None:
        """Numbers for `step.h`; None on a device, or for a subclass."""
        if type(self) is not ChoiPlant or self.device is not None:
            return None
        return compiled.numbers(self.physics)

    def initial(
        self, rear_x: np.ndarray, rear_y: np.ndarray, heading: np.ndarray, speed: np.ndarray
    ) -> BodyState:
        """Return N upright bicycles with straight handlebars; arguments (N,), m, rad, m/s."""
        return dynamics.upright(rear_x, rear_y, heading, speed, self.physics.constants)

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
            ValueError: on loads, which the paper's equations do not include.
        """
        if loads is not None:
            raise ValueError("the paper's bicycle takes no loads: choose the plant whipple")
        inputs = torque, displacement, pedal_force
        if self.device is not None:
            # Only training on a device needs torch; a ride must not load it.
            from bicycle_sim.plants.choi import tensor_dynamics

            return tensor_dynamics.step(self.device, self.physics, state, inputs, speed_limits)
        return dynamics.step(state, *inputs, self.physics, speed_limits)

    def pushed(self, state: BodyState, lean_rate: Array) -> BodyState:
        """Return the state after a push that adds `lean_rate`, rad/s, float or (N,)."""
        return replace(state, lean_rate=state.lean_rate + lean_rate)

    def yaw_rate(self, state: BodyState) -> np.ndarray:
        """Return the yaw rate (N,), rad/s, on the front contact's circle (eq. 3)."""
        turning: np.ndarray = np.sin(state.steer_angle) / self.physics.constants.wheelbase
        return state.speed * turning

    def fallen(self, state: BodyState, limit: float) -> np.ndarray:
        """Return (N,) bool: True if it leans by more than `limit`, rad."""
        lies: np.ndarray = dynamics.fallen(state.lean_angle, limit)
        return lies

    def linearize(self, speed: float, discrete: bool = False) -> Linear:
        """Return the plant linearised about riding straight at a speed, m/s; see `choi.linear`."""
        a, b = _MODELS[discrete](speed, self.physics)
        return Linear(STATE_FIELDS, INPUT_FIELDS, a, b, self.time_step if discrete else None)

    def steady_lean(self, steer_angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return the lean of a balanced steady turn, (N,) rad; arguments (N,), rad and m/s."""
        lean: np.ndarray = steady_lean(steer_angle, speed, self.physics.constants)
        return lean

    def take(self, mask: np.ndarray) -> ChoiPlant:
        """Return this plant: all bicycles are alike."""
        return self

    def to_json(self) -> str:
        """Return all parameters as JSON, exact to the bit, with the key `plant`."""
        return json.dumps({"plant": self.name, **asdict(self.physics)})

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> ChoiPlant:
        """Return the plant that `to_json` wrote, from plain data with or without `plant`.

        Raises:
            ValueError: on an unknown key or an invalid value.
        """
        values = {key: value for key, value in data.items() if key != "plant"}
        return cls(Physics.from_json(json.dumps(values)))


_MODELS = {False: continuous, True: discrete}
