"""A controller that only keeps upright: it steers into the lean and knows no goal."""

from __future__ import annotations

import math

import numpy as np

from bicycle_common import steer_into_lean
from bicycle_common.validation import require

LEAN_RATE = 3
"""Column of the lean rate in an observation."""


class SteerIntoLean:
    """Steer torque in proportion to the lean rate, see `bicycle_common.steer_into_lean`."""

    def __init__(self, torque_limit: float, gain: float = steer_into_lean.GAIN) -> None:
        """Use this limit, N m, and gain, N m per rad/s and m/s.

        Raises:
            ValueError: on a gain that is not above zero.
        """
        require(math.isfinite(gain) and gain > 0, f"gain must be above zero, not {gain!r}")
        self.policy_id = f"steer-into-lean-{gain:g}"
        self._limit, self._gain = torque_limit, gain

    def act(self, observation: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return the actions (N, 3) for states (N, 6) at speeds (N,); see `Controller.act`."""
        action = np.zeros((len(speed), 3))
        rate = observation[:, LEAN_RATE]
        action[:, 0] = steer_into_lean.torque(rate, speed, self._limit, self._gain)
        return action
