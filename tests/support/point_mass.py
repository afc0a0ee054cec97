"""A plant for tests only: a point mass on a stick whose handlebar obeys a spring and a damper.

It has a state of its own, rides at one speed, knows no displacement and no pedal, and falls
sooner than the scenario says. Nothing of the product knows it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from bicycle_sim.plants.base import Array, BodyState, Geometry, Linear, Loads, Plant

GRAVITY, HEIGHT, LENGTH = 9.81, 1.0, 1.0
STATES = ("steer_rate", "heading_error", "lean_rate", "steer_angle", "lean_angle")
"""States in an order of their own, so that users of the linear model must go by names."""


@dataclass
class PointMassState(BodyState):
    """State with the torque of the step before, which still acts."""

    last_torque: np.ndarray


class PointMass(Plant[PointMassState]):
    """N of them, all alike."""

    name = "point-mass"
    state_type = PointMassState

    def __init__(self, stiffness: float = 20.0, damping: float = 9.0) -> None:
        self.stiffness, self.damping = stiffness, damping

    @property
    def time_step(self) -> float:
        return 0.02

    @property
    def count(self) -> int | None:
        return None

    @property
    def input_names(self) -> tuple[str, ...]:
        return ("torque",)

    @property
    def label(self) -> str:
        return f"point-mass {self.stiffness:g}"

    @property
    def geometry(self) -> Geometry:
        return Geometry(LENGTH, 0.0, 0.0, 0.3, 0.3, 80.0, 0.5, HEIGHT, HEIGHT, 1.2)

    def initial(
        self, rear_x: np.ndarray, rear_y: np.ndarray, heading: np.ndarray, speed: np.ndarray
    ) -> PointMassState:
        zero = np.zeros(len(rear_x))
        names = [item.name for item in fields(PointMassState)]
        values = dict.fromkeys(names, zero) | {
            "rear_x": rear_x + 0.0,
            "rear_y": rear_y + 0.0,
            "heading": heading + 0.0,
            "speed": speed + 0.0,
        }
        return self._on_wheels(PointMassState(**values))

    def _on_wheels(self, state: PointMassState) -> PointMassState:
        return replace(
            state,
            front_x=state.rear_x - LENGTH * np.sin(state.heading),
            front_y=state.rear_y + LENGTH * np.cos(state.heading),
        )

    def step(
        self,
        state: PointMassState,
        torque: np.ndarray,
        displacement: np.ndarray,
        pedal_force: np.ndarray,
        speed_limits: tuple[Array, Array] | None = None,
        loads: Loads | None = None,
    ) -> PointMassState:
        if np.any(displacement) or np.any(pedal_force):
            raise ValueError("a point mass has a handlebar only")
        dt, s = self.time_step, state
        lean, steer = self._accelerations(s)
        lean_rate, steer_rate = s.lean_rate + dt * lean, s.steer_rate + dt * steer
        moved = replace(
            s,
            lean_acceleration=lean,
            lean_rate=lean_rate,
            lean_angle=s.lean_angle + dt * lean_rate,
            steer_rate=steer_rate,
            steer_angle=np.clip(s.steer_angle + dt * steer_rate, -1.2, 1.2),
            heading=np.remainder(s.heading + dt * self.yaw_rate(s) + np.pi, 2 * np.pi) - np.pi,
            rear_x=s.rear_x - dt * s.speed * np.sin(s.heading),
            rear_y=s.rear_y + dt * s.speed * np.cos(s.heading),
            last_torque=torque + 0.0,
        )
        return self._on_wheels(moved)

    def _accelerations(self, s: PointMassState) -> tuple[np.ndarray, np.ndarray]:
        turning = s.speed * s.speed / LENGTH * np.tan(s.steer_angle)
        lean = (GRAVITY * np.sin(s.lean_angle) - turning * np.cos(s.lean_angle)) / HEIGHT
        steer = 10.0 * s.last_torque - self.stiffness * s.steer_angle - self.damping * s.steer_rate
        return lean, steer

    def pushed(self, state: PointMassState, lean_rate: Array) -> PointMassState:
        return replace(state, lean_rate=state.lean_rate + lean_rate)

    def yaw_rate(self, state: PointMassState) -> np.ndarray:
        return state.speed * np.tan(state.steer_angle) / LENGTH

    def fallen(self, state: PointMassState, limit: float) -> np.ndarray:
        return np.abs(state.lean_angle) > 0.9 * limit

    def linearize(self, speed: float, discrete: bool = False) -> Linear:
        size, place = len(STATES), {name: index for index, name in enumerate(STATES)}
        a, b = np.zeros((size, size)), np.zeros((size, 1))
        a[place["lean_angle"], place["lean_rate"]] = 1.0
        a[place["steer_angle"], place["steer_rate"]] = 1.0
        a[place["lean_rate"], place["lean_angle"]] = GRAVITY / HEIGHT
        a[place["lean_rate"], place["steer_angle"]] = -speed * speed / LENGTH / HEIGHT
        a[place["steer_rate"], place["steer_angle"]] = -self.stiffness
        a[place["steer_rate"], place["steer_rate"]] = -self.damping
        a[place["heading_error"], place["steer_angle"]] = speed / LENGTH
        b[place["steer_rate"], 0] = 10.0
        if not discrete:
            return Linear(STATES, ("torque",), a, b)
        # The command acts a step later, which makes one state more.
        dt = self.time_step
        grown, given = np.eye(size + 1), np.zeros((size + 1, 1))
        grown[:size, :size] += dt * a
        grown[:size, size], grown[size, size], given[size, 0] = dt * b[:, 0], 0.0, 1.0
        return Linear((*STATES, "last_torque"), ("torque",), grown, given, dt)

    def steady_lean(self, steer_angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
        turning: np.ndarray = speed * speed / LENGTH * np.tan(steer_angle) / GRAVITY
        return np.arctan(turning)

    def take(self, mask: np.ndarray) -> PointMass:
        return self

    def to_json(self) -> str:
        return json.dumps(
            {"plant": self.name, "stiffness": self.stiffness, "damping": self.damping}
        )

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> PointMass:
        return cls(**{key: value for key, value in data.items() if key != "plant"})
