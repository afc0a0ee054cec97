"""Interface of every controller: actions for observations."""

from __future__ import annotations

from typing import Protocol

import numpy as np


class Controller(Protocol):
    """A learned actor, the LQR, or anything else that controls N bicycles at once.

    A controller that wants to know the past has two more attributes, `memory`, the number of past
    control periods, and `plant_parameters`, names of the bicycle's parameters (see
    `past.parameters_of`), and takes a `past.Past` as third argument of `act`. `riding.Riding`
    remembers for it.
    """

    @property
    def policy_id(self) -> str:
        """Id of the controller and its parameters; every command carries it."""
        ...

    def act(self, observation: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return the action for each bicycle, without memory of earlier calls.

        Args:
            observation: (N, 6), see `bicycle_sim.task.task.OBSERVATION_FIELDS`.
            speed: (N,) m/s.

        Returns:
            (N, 3) in physical units, see `bicycle_sim.task.task.ACTION_FIELDS`: N m, m, N.
        """
        ...
