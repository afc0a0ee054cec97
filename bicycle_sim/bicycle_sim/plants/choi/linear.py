"""The bicycle linearised about riding straight and upright at one speed.

Equations 5-7 in either sign of errata row 13, for designing controllers and for checking the
dynamics: the eigenvalues are those of the errata's table of linearised facts
(`docs/errata.md`, "Linearised facts").
"""

from __future__ import annotations

from types import ModuleType

import numpy as np

from bicycle_common.geometry import Array
from bicycle_sim.plants.choi.dynamics import curvatures
from bicycle_sim.plants.choi.parameters import Constants, Physics

STATE_FIELDS = ("lean_angle", "lean_rate", "steer_angle", "steer_rate", "heading_error")
"""The linear state: rad, rad/s, rad, rad/s, rad (omega, omega dot, theta, theta dot, psi_g)."""

INPUT_FIELDS = ("torque", "displacement")
"""The linear input: N m (T) and m (d)."""

_ANGLES, _RATES = [0, 2], [1, 3]


def accelerations(speed: float, physics: Physics) -> tuple[np.ndarray, np.ndarray]:
    """Return how state and input accelerate lean and steering at a speed, m/s.

    Returns:
        (2, 5) and (2, 2): rows are the lean and the steering acceleration, rad/s^2; columns
        are STATE_FIELDS and INPUT_FIELDS.
    """
    k = physics.constants
    wheel_rate = speed / k.tyre_radius
    moment = k.mass * k.mass_height
    turning = (2.0 * k.tyre_mass * k.tyre_radius + moment) / k.wheelbase
    coupling = k.tyre_spin_inertia if physics.gyroscopic_correction else -k.tyre_lean_inertia
    lean = (moment * k.gravity, 0.0, -speed * speed * turning, -k.tyre_spin_inertia * wheel_rate)
    state = np.zeros((2, 5))
    state[0, :4] = np.array(lean) / k.lean_inertia
    state[1, 1] = coupling * wheel_rate / k.tyre_steer_inertia
    inputs = np.zeros((2, 2))
    inputs[0, 1] = moment * k.gravity / k.mass_height / k.lean_inertia
    inputs[1, 0] = 1.0 / k.tyre_steer_inertia
    return state, inputs


def continuous(speed: float, physics: Physics) -> tuple[np.ndarray, np.ndarray]:
    """Return A (5, 5) and B (5, 2) of dx/dt = A x + B u at a speed, m/s, for a distant goal."""
    from_state, from_input = accelerations(speed, physics)
    a, b = np.zeros((5, 5)), np.zeros((5, 2))
    a[_ANGLES, _RATES] = 1.0
    a[_RATES], b[_RATES] = from_state, from_input
    a[4, 2] = speed / physics.constants.wheelbase
    return a, b


def discrete(speed: float, physics: Physics) -> tuple[np.ndarray, np.ndarray]:
    """Return A (5, 5), B (5, 2) of one `dynamics.step`: rates first, then angles with new rates.

    This is the Jacobian of that step about straight riding, not an approximation of the
    continuous model's matrix exponential.
    """
    from_state, from_input = accelerations(speed, physics)
    dt = physics.constants.time_step
    a, b = np.eye(5), np.zeros((5, 2))
    a[_RATES] += dt * from_state
    b[_RATES] += dt * from_input
    a[_ANGLES] += dt * a[_RATES]
    b[_ANGLES] += dt * b[_RATES]
    turn = speed * dt / physics.constants.wheelbase
    a[4] += turn * a[2]
    b[4] += turn * b[2]
    return a, b


def eigenvalues(speed: float, physics: Physics) -> np.ndarray:
    """Return the poles of lean and steering, (4,) complex, 1/s, unstable first; speed in m/s."""
    a, _ = continuous(speed, physics)
    poles = np.linalg.eigvals(a[:4, :4])
    return poles[np.argsort(-poles.real)]


def steady_lean(
    steer_angle: Array, speed: Array, constants: Constants, xp: ModuleType = np
) -> Array:
    """Return the tilt of the centre of mass that balances a steady turn (phi of eq. 5-6), rad.

    Not linearised: with this tilt and no rates the lean acceleration is exactly zero.

    Args:
        steer_angle: (N,) rad.
        speed: (N,) m/s.
        constants: Table 1.
        xp: numpy or torch.
    """
    k = constants
    moment = k.mass * k.mass_height
    front, rear, mass = curvatures(steer_angle, k, xp)
    turning = k.tyre_mass * k.tyre_radius * (front + rear) + moment * mass
    return xp.arctan(xp.sign(steer_angle) * speed * speed * turning / (moment * k.gravity))
