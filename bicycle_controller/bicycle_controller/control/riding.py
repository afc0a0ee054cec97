"""Rides under one controller, with the memory that it needs."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from bicycle_controller.control.controller import Controller
from bicycle_controller.control.past import Past, parameters_of
from bicycle_sim.plants.base import Plant


class Riding:
    """N rides at once. A controller without memory is asked as it is.

    In every control period `act` is called with the state, as often as wanted, and then `acted`
    once with the command that was sent.
    """

    def __init__(
        self, controller: Controller, count: int = 1, plant: Plant[Any] | None = None
    ) -> None:
        """Begin `count` rides.

        Args:
            controller: chooses the actions.
            count: N.
            plant: the ridden bicycles, for a controller with their parameters as inputs.

        Raises:
            ValueError: if it needs a parameter that the plant does not have.
        """
        self.controller = controller
        length = getattr(controller, "memory", 0)
        names = getattr(controller, "plant_parameters", ())
        self._past: Past | None = None
        if length or names:
            if names and plant is None:
                raise ValueError(f"{controller.policy_id} has to be told which bicycle it rides")
            parameters = None if plant is None else parameters_of(plant, names, count)
            self._past = Past(count, length, parameters)
        self._begins = np.ones(count, dtype=bool)

    def act(self, observation: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return the actions (N, 3) for states (N, 6) at speeds (N,); nothing is remembered."""
        if self._past is None:
            return self.controller.act(observation, speed)
        if self._begins.any():
            self._past.fill(self._begins, observation, speed)
        return self.controller.act(observation, speed, self._past)  # type: ignore[call-arg]

    def acted(self, observation: np.ndarray, speed: np.ndarray, action: np.ndarray) -> None:
        """Remember a period: what was seen, and the command (N, 3) as it was sent."""
        if self._past is None:
            return
        if self._begins.any():
            self._past.fill(self._begins, observation, speed)
            self._begins = np.zeros_like(self._begins)
        self._past.push(observation, speed, action)

    def missed(self, periods: int) -> None:
        """Repeat the newest period for periods without a received state."""
        if self._past is None or self._begins.any() or not self._past.rows.shape[1]:
            return
        for _ in range(min(periods, self._past.rows.shape[1])):
            self._past.rows[:, 1:] = self._past.rows[:, :-1].copy()

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Forget the past of the rides of `mask` (N,), or of all: they begin anew."""
        self._begins = self._begins | True if mask is None else self._begins | mask

    def keep(self, mask: np.ndarray) -> None:
        """Go on with the rides of `mask` (N,) only."""
        self._begins = self._begins[mask]
        if self._past is not None:
            self._past.keep(mask)

    def repeated(self, count: int) -> Riding:
        """Return `count` rides with the memory of the first one."""
        rides = copy.copy(self)
        rides._past = copy.copy(self._past)
        rides.keep(np.zeros(count, dtype=np.intp))
        return rides
