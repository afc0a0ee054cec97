"""The bicycle's model as the filter uses it: coefficients of its accelerations over speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from bicycle_sim.plants.base import Linear, Plant

AXES = ("lean_angle", "lean_rate", "steer_angle", "steer_rate")
"""Inputs of accelerations and yaw rate, in the order of the filter's first four states."""
ROWS = ("lean_rate", "steer_rate", "heading_error")
"""Outputs whose derivatives are used; the heading error grows with the yaw rate."""
SPEEDS = (1.0, 3.0, 6.0)
"""m/s through which a parabola goes; the Whipple bicycle's coefficients are one in the speed."""
STEEPEST = 1.2
"""rad of steering beyond which its tangent is not followed."""


@dataclass(frozen=True)
class Coefficients:
    """Linear coefficients at the speeds of N bicycles."""

    axes: np.ndarray
    """(N, 3, 4), of ROWS on AXES."""
    torque: np.ndarray
    """(N, 3) or (1, 3), of ROWS on the steer torque."""


class Model:
    """Accelerations of lean and steering, and the yaw rate, of N bicycles."""

    def __init__(self, plant: Plant[Any]) -> None:
        """Take the plant's linear model at three speeds.

        Args:
            plant: whose parameters the model has; of one bicycle or of many.
        """
        parts = [_parts(plant.linearize(speed)) for speed in SPEEDS]
        axes = np.stack([part[0] for part in parts])
        # The parabola through the three speeds, as powers of the speed.
        inverse = np.linalg.inv(np.vander(SPEEDS, 3, increasing=True))
        self._powers = np.einsum("pk,k...->p...", inverse, axes)
        if self._powers.ndim == 3:
            self._powers = self._powers[:, None]
        self.torque = np.atleast_2d(parts[1][1])

        self.friction = np.asarray(plant.steer_friction, dtype=float)
        """N m, () or (N,), of the steering; a higher stiction is not followed."""
        self._pitch = _pitch(plant)

    def pitch(self, lean: np.ndarray, steer: np.ndarray) -> np.ndarray:
        """(N,) rad that the frame's nose is up, as the steering makes it: a quadratic form."""
        found: np.ndarray = (
            self._pitch[0] * steer * steer
            + self._pitch[1] * steer * lean
            + self._pitch[2] * lean * lean
        )
        return found

    def at(self, speed: np.ndarray) -> Coefficients:
        """The coefficients at speeds (N,), m/s."""
        v = speed[:, None, None]
        constant, first, second = self._powers
        return Coefficients(constant + v * (first + v * second), self.torque)

    @staticmethod
    def rates(k: Coefficients, lean: np.ndarray, bent: np.ndarray) -> np.ndarray:
        """(N, 3), ROWS without the torque's part.

        Args:
            k: at the bicycles' speeds.
            lean: (N,) rad.
            bent: (N, 4), `bend` of the state.
        """
        found = np.einsum("nij,nj->ni", k.axes, bent)
        found[:, 2] /= np.cos(lean)
        return found

    def gripped(
        self, k: Coefficients, rates: np.ndarray, steer_rate: np.ndarray, dt: float
    ) -> np.ndarray:
        """Return `rates` (N, 3) less what the steering's friction takes off them.

        Coulomb friction brings the steering to rest within `dt` s where it can, and else takes its
        whole torque. Without it, the model turns a steering that sticks.

        Args:
            k: at the bicycles' speeds.
            rates: (N, 3), ROWS under every other torque.
            steer_rate: (N,) rad/s.
            dt: s, of the step.
        """
        if not self.friction.any():
            return rates
        needed = -(steer_rate / dt + rates[:, 1]) / k.torque[:, 1]
        torque = np.minimum(np.maximum(needed, -self.friction), self.friction)
        found: np.ndarray = rates + k.torque * torque[:, None]
        return found


def bend(state: np.ndarray) -> np.ndarray:
    """(N, 4), AXES with gravity's and steering's largest nonlinearities: sine and tangent."""
    steer = np.minimum(np.maximum(state[:, 2], -STEEPEST), STEEPEST)
    found = state[:, :4].copy()
    found[:, 0] = np.sin(state[:, 0])
    found[:, 2] = np.tan(steer)
    return found


def _pitch(plant: Plant[Any]) -> np.ndarray:
    """The coefficients of steer^2, steer lean and lean^2, of the plant or its first bicycle."""
    leans, steers = np.meshgrid(np.linspace(-0.3, 0.3, 7), np.linspace(-0.5, 0.5, 7))
    lean, steer = leans.ravel(), steers.ravel()
    if plant.count is not None:  # one bicycle for each pose, all of them the first
        plant = plant.take(np.zeros(len(lean), dtype=int))
    basis = np.stack([steer * steer, steer * lean, lean * lean], 1)
    found: np.ndarray = np.linalg.lstsq(basis, plant.pitch_on_road(lean, steer), rcond=None)[0]
    return found


def _parts(linear: Linear) -> tuple[np.ndarray, np.ndarray]:
    """(..., 3, 4) on AXES and (..., 3) on the torque of a continuous linear model."""
    rows = [linear.states.index(name) for name in ROWS]
    columns = [linear.states.index(name) for name in AXES]
    axes = linear.a[..., rows, :][..., columns]
    if "motor_torque" in linear.states:
        return axes, linear.a[..., rows, linear.states.index("motor_torque")]
    return axes, linear.b[..., rows, linear.inputs.index("torque")]
