"""The yardstick of kicks: the best of a stated grid of LQR weights, for that very bicycle.

Each LQR is designed for the bicycle, its delay, its motor's lag and its torque limit, remembers
its own commands, and has the same heading loop. Who sees no bicycle's file is compared with one
who has read it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from bicycle_controller.control.lqr import LqrConfig, LqrController
from bicycle_controller.evaluation.kicks import Kicks, Trial, largest
from bicycle_sim.plants.base import Plant

LEAN_LEAD = 5.0
"""`LqrConfig.lean_lead` of the grid: a kick of the lean counts in full."""


@dataclass(frozen=True)
class Weights:
    """Weights of one point of the grid."""

    lean: float
    """Cost of a squared rad."""
    lean_rate: float
    """Cost of a squared rad/s."""
    steer: float
    """Cost of a squared rad."""
    steer_rate: float
    """Cost of a squared rad/s."""
    heading: float
    """Cost of a squared rad."""
    torque: float
    """Cost of a squared N m."""

    def config(self, torque_limit: float) -> LqrConfig:
        """Return the tuning with these weights."""
        states = self.lean, self.lean_rate, self.steer, self.steer_rate, self.heading
        return LqrConfig(
            torque_limit=torque_limit,
            state_weights=states,
            torque_weight=self.torque,
            lean_lead=LEAN_LEAD,
        )


_QUICK, _EVEN, _LIGHT = (6.0, 0.4, 0.03, 0.4), (10.0, 1.0, 1.0, 0.1), (1.0, 1.0, 0.1, 0.01)

GRID = tuple(
    Weights(*states, heading, torque)
    for states, heading, torque in (
        (_EVEN, 0.05, 0.02),
        (_EVEN, 0.05, 0.5),
        (_EVEN, 0.5, 0.1),
        (_EVEN, 5.0, 0.1),
        (_LIGHT, 0.05, 0.02),
        (_LIGHT, 0.05, 0.5),
        (_LIGHT, 0.5, 0.02),
        (_QUICK, 0.05, 0.02),
        (_QUICK, 0.05, 0.1),
        (_QUICK, 0.5, 0.1),
    )
)
"""The grid. On three bicycles, delays of 25 to 75 ms and four speeds, no single one of 54 sets of
weights caught more than 1.04 times the best of these in any cell."""


@lru_cache(maxsize=64)
def controllers(plant: Plant[Any], torque_limit: float) -> tuple[LqrController, ...]:
    """Return the LQR of each of GRID for a bicycle; kept, for it takes a second or two."""
    controllers = []
    for weights in GRID:
        try:
            controllers.append(LqrController(weights.config(torque_limit), plant))
        except (ArithmeticError, np.linalg.LinAlgError):
            continue  # such weights have no LQR for this bicycle
    return tuple(controllers)


@dataclass(frozen=True)
class Best:
    """The best of the grid at one speed."""

    kicks: Kicks
    """Kicks that this LQR catches."""
    controller: LqrController

    def share(self, kicks: Kicks) -> float | None:
        """Return what another controller catches as a share; None if this one catches nothing."""
        return kicks.caught / self.kicks.caught if self.kicks.caught else None

    def summary(self) -> dict[str, Any]:
        """Return plain data, ready for JSON."""
        config = self.controller.config
        weights = {"states": list(config.state_weights), "torque": config.torque_weight}
        return {**self.kicks.summary(), "controller": self.controller.policy_id, **weights}


def best(
    plant: Plant[Any],
    speed: float,
    limits: tuple[float, float, float] | np.ndarray,
    trial: Trial | None = None,
) -> Best:
    """Return the LQR of the grid that catches the largest kick; see `kicks.largest`.

    Among equals it is the one whose four kicks are larger in sum.

    Raises:
        ValueError: as `kicks.largest`, or if no LQR rides this bicycle.
    """
    found = [
        Best(largest(controller, plant, speed, limits, trial), controller)
        for controller in controllers(plant, float(limits[0]))
    ]
    if not found:
        raise ValueError(f"no LQR of the grid can be designed for the bicycle {plant.label}")
    return max(found, key=lambda item: (item.kicks.caught, *_sum(item.kicks)))


def _sum(kicks: Kicks) -> tuple[float]:
    return (sum(kicks.straight) + sum(kicks.turn),)
