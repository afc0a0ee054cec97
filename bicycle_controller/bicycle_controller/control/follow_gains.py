"""Gains of the path follower: LQR with preview of the curvature, for every speed.

The plant's linear model is seen from the path: to its states come the cross-track error, and the
path's curvature as a disturbance that is known ahead. In a steady turn of curvature kappa the
states are X kappa and the torque is U kappa, so the deviations from the steady turn obey

    e[k+1] = A e[k] + B u[k] + X (kappa[k] - kappa[k+1]),

and the best torque is -K e[k] less the sum over i of F[i] (kappa[k+i] - kappa[k+i+1]), with
F[i] = (R + B'PB)^-1 B' (A - B K)'^i P X (Sharp 2007, doi:10.1243/09544062JMES564, gives the
preview gains of a bicycle in this form).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from bicycle_common.validation import require
from bicycle_sim.plants.base import Plant

SEEN = ("lean_angle", "lean_rate", "steer_angle", "steer_rate", "heading_error", "cross_track")
"""States that a follower sees, in the order of its gains."""
SPEEDS = np.linspace(1.0, 8.0, 57)
"""m/s, for which gains are computed; the nearest one holds."""


@dataclass(frozen=True)
class FollowConfig:
    """Tuning of a follower.

    Raises:
        ValueError: on a number that is not finite and above zero.
    """

    torque_limit: float = 2.0
    """N m, largest |T|."""
    pedal_limit: float = 100.0
    """N, largest |F|."""
    weights: tuple[float, ...] = (6.0, 0.4, 0.03, 0.4, 10.0, 1.0)
    """Cost of squared deviations from the steady turn, in the order of SEEN."""
    torque_weight: float = 1.0
    """Cost of squared torque besides the holding torque."""
    preview: float = 2.5
    """s of path that the torque is planned for."""
    approach: float = 0.9
    """rad, largest angle at which the path is approached from far."""
    lean_limit: float = 0.25
    """rad, steepest lean wanted in a turn."""
    steer_limit: float = 0.6
    """rad, largest steering wanted in a turn."""
    lean_lead: float = 1.4
    """Largest lead of the wanted lean over the present one; 1 is where full torque answers."""
    near: float = 2.0
    """m of cross-track error up to which the path's curvature counts; at twice as much not."""
    speed_gain: float = 200.0
    """N of pedal force per m/s that is missing."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "weights", tuple(map(float, self.weights)))
        require(len(self.weights) == len(SEEN), f"weights needs {len(SEEN)} numbers")
        for item in fields(self):
            value = getattr(self, item.name)
            for number in value if isinstance(value, tuple) else (value,):
                good = math.isfinite(number) and number >= 0.0
                require(good, f"{item.name} must be finite and zero or more, not {value!r}")


@dataclass(frozen=True)
class Gains:
    """Gains at one speed."""

    feedback: np.ndarray
    """(6,) torque per deviation, in the order of SEEN."""
    preview: np.ndarray
    """(H,) torque per change of curvature in each of the next periods."""
    steer: float
    """tan(steering) per curvature, m."""
    hold: float
    """N m of holding torque per curvature, m N m."""
    turn: float
    """rad of steering with which a heading error is answered, per rad."""


def design(config: FollowConfig, plant: Plant[Any], speed: float) -> Gains:
    """Return the gains at one speed, m/s."""
    from scipy.linalg import solve_discrete_are

    model = plant.linearize(speed, discrete=True)
    names = [*model.states, "cross_track"]
    n, heading = len(model.states), model.states.index("heading_error")
    assert model.time_step is not None
    a = np.zeros((n + 1, n + 1))
    b = np.zeros((n + 1, 1))
    a[:n, :n] = model.a
    b[:n, 0] = model.b[:, model.inputs.index("torque")]
    # The mean of the old and the new heading error carries the bicycle off the path.
    a[n, :n] = 0.5 * speed * model.time_step * (model.a[heading] + np.eye(n)[heading])
    b[n] = 0.5 * speed * model.time_step * b[heading]
    a[n, n] = 1.0
    steady, hold = _steady_turn(plant, speed)
    turn = np.array([_of_turn(name, steady, hold) for name in names])

    weights = dict(zip(SEEN, config.weights, strict=True))
    q = np.diag([weights.get(name, 0.0) for name in names])
    r = np.array([[config.torque_weight]])
    cost = solve_discrete_are(a, b, q, r)
    inverse = 1.0 / float((r + b.T @ cost @ b)[0, 0])
    gain = inverse * (b.T @ cost @ a)[0]
    closed = a - b @ gain[None]
    pending = cost @ turn
    preview = np.empty(round(config.preview / model.time_step))
    for index in range(len(preview)):
        preview[index] = inverse * float(b[:, 0] @ pending)
        pending = closed.T @ pending
    seen = gain[[names.index(name) for name in SEEN]]
    lean, steer = steady["lean_angle"], steady["steer_angle"]
    # The steady turn whose torque answers a heading error; see LqrController._design. Commands
    # under way and a motor's torque are those of that turn, too.
    others = float(sum(gain[i] * turn[i] for i in range(n) if names[i] not in SEEN))
    answered = (hold + seen[0] * lean + seen[2] * steer + others) / steer
    return Gains(seen, preview, steer, hold, float(-seen[4] / answered))


def _of_turn(name: str, steady: dict[str, float], hold: float) -> float:
    """Return a state's value in a steady turn of curvature 1/m."""
    if name.startswith("torque["):
        return hold
    return steady.get(name, 0.0)


def _steady_turn(plant: Plant[Any], speed: float) -> tuple[dict[str, float], float]:
    """Return the states and the torque of the linear steady turn, per 1/m of curvature."""
    model = plant.linearize(speed)
    heading = model.states.index("heading_error")
    column = model.inputs.index("torque")
    columns = [i for i in range(len(model.states)) if i != heading]
    matrix = np.column_stack([model.a[:, columns], model.b[:, column]])
    rate = np.zeros(len(model.states))
    rate[heading] = speed
    found = np.linalg.solve(matrix, rate)
    names = [model.states[i] for i in columns]
    return dict(zip(names, map(float, found[:-1]), strict=True)), float(found[-1])
