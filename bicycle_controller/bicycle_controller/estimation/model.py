"""The bicycle's model as the filter uses it: coefficients of its accelerations over speed."""

from __future__ import annotations

from typing import Any

import numpy as np

from bicycle_sim.plants.base import Linear, Plant

AXES = ("lean_angle", "lean_rate", "steer_angle", "steer_rate")
"""Inputs of accelerations and yaw rate, in the order of the filter's first four states."""
ROWS = ("lean_rate", "steer_rate", "heading_error")
"""Outputs whose derivatives are used; the heading error grows with the yaw rate."""
SPEEDS = (1.0, 3.0, 6.0)
"""m/s through which a parabola goes; the Whipple bicycle's coefficients are one in the speed."""


class Model:
    """Coefficients of the accelerations of lean and steering, and of the yaw rate.

    They are of one bicycle (K = 1) or of each of N (K = N).
    """

    def __init__(self, plant: Plant[Any]) -> None:
        """Take the plant's linear model at three speeds.

        Args:
            plant: whose parameters the model has; of one bicycle or of many.
        """
        parts = [_parts(plant.linearize(speed)) for speed in SPEEDS]
        axes = np.stack([part[0] for part in parts])
        # The parabola through the three speeds, as powers of the speed.
        inverse = np.linalg.inv(np.vander(SPEEDS, 3, increasing=True))
        powers = np.einsum("pk,k...->p...", inverse, axes)
        if powers.ndim == 3:
            powers = powers[:, None]
        friction = np.asarray(plant.steer_friction, dtype=float)
        kinds = max(powers.shape[1], friction.size)
        self.powers = np.broadcast_to(powers, (3, kinds, 3, 4)).copy()
        """(3, K, 3, 4), of ROWS on AXES, times the speed's powers 0 to 2."""
        self.torque = np.broadcast_to(np.atleast_2d(parts[1][1]), (kinds, 3)).copy()
        """(K, 3), of ROWS on the steer torque."""
        self.friction = np.broadcast_to(friction, (kinds,)).copy()
        """(K,) N m, of the steering; a higher stiction is not followed."""
        self.pitch = _pitch(plant)
        """(3,) coefficients of steer^2, steer lean and lean^2: rad that the nose is up, as the
        steering makes it."""


def _pitch(plant: Plant[Any]) -> np.ndarray:
    """The coefficients of the plant's pitch, or of its first bicycle's."""
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
