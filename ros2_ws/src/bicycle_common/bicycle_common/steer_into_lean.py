"""The law that keeps a real bicycle upright when nobody commands it: steer into the lean.

The steer-by-wire bicycles of TU Delft balance themselves so: a torque in proportion to the lean
rate, less of it the faster they ride, none where they balance themselves. It needs a gyroscope and
a wheel's speed, so a microcontroller can do it when the computer is silent.
"""

from __future__ import annotations

from typing import Any

import numpy as np

GAIN = 20.0
"""N m per rad/s of lean rate and m/s below SPEED (kappa)."""
SPEED = 6.0
"""Speed from which on the torque is zero, m/s."""


def torque(lean_rate: Any, speed: Any, limit: float, gain: float = GAIN) -> Any:
    """Return the steer torque, N m, in the direction of `lean_rate`; floats or arrays (N,).

    Args:
        lean_rate: rad/s.
        speed: m/s.
        limit: N m, largest size of the torque.
        gain: see GAIN.
    """
    missing = np.maximum(SPEED - speed, 0.0)
    return np.minimum(np.maximum(gain * missing * lean_rate, -limit), limit)
