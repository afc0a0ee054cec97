"""Memory of a controller during a ride: past observations, speeds and commands."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from bicycle_common.observation import ACTION_FIELDS, OBSERVATION_FIELDS
from bicycle_sim.plants.base import Plant

ROW_FIELDS = (*OBSERVATION_FIELDS, "speed", *ACTION_FIELDS)
"""Fields of a row: observation and speed at a control period's start, and the command sent."""
SPEED = len(OBSERVATION_FIELDS)
"""Column of the speed in a row; the observation is before it, the action behind it."""
PARAMETER = "plant."
"""Beginning of the name of a parameter of the ridden bicycle."""


class Past:
    """The last control periods of N rides, and what is known of their bicycles.

    Attributes:
        rows: (N, K, 10) ROW_FIELDS of the last K periods, the newest first.
        plant_parameters: (N, M) the bicycles' parameters that the controller asked for.
    """

    def __init__(
        self, count: int, length: int, plant_parameters: np.ndarray | None = None
    ) -> None:
        """Begin with zeros."""
        self.rows = np.zeros((count, length, len(ROW_FIELDS)))
        self.plant_parameters = (
            np.zeros((count, 0)) if plant_parameters is None else plant_parameters
        )

    @property
    def observation(self) -> np.ndarray:
        """(N, K, 6), see OBSERVATION_FIELDS."""
        return self.rows[..., :SPEED]

    @property
    def speed(self) -> np.ndarray:
        """(N, K) m/s."""
        return self.rows[..., SPEED]

    @property
    def action(self) -> np.ndarray:
        """(N, K, 3) commands as they were sent, see ACTION_FIELDS."""
        return self.rows[..., SPEED + 1 :]

    @classmethod
    def of_start(
        cls,
        observation: np.ndarray,
        speed: np.ndarray,
        length: int,
        plant_parameters: np.ndarray | None = None,
    ) -> Past:
        """Return the past of rides that begin: as if it had always been so, without commands."""
        past = cls(len(observation), length, plant_parameters)
        past.fill(np.ones(len(observation), dtype=bool), observation, speed)
        return past

    def fill(self, mask: np.ndarray, observation: np.ndarray, speed: np.ndarray) -> None:
        """Let the rides of `mask` (N,) begin with this state, see `of_start`."""
        self.rows[mask] = 0.0
        self.rows[mask, :, :SPEED] = observation[mask, None]
        self.rows[mask, :, SPEED] = speed[mask, None]

    def push(self, observation: np.ndarray, speed: np.ndarray, action: np.ndarray) -> None:
        """Add the newest period, (N, 6), (N,) and (N, 3); the oldest is forgotten."""
        rows = np.empty_like(self.rows)
        rows[:, 1:] = self.rows[:, :-1]
        rows[:, 0, :SPEED], rows[:, 0, SPEED], rows[:, 0, SPEED + 1 :] = observation, speed, action
        self.rows = rows

    def keep(self, mask: np.ndarray) -> None:
        """Go on with the rides of `mask` (N,) only."""
        self.rows, self.plant_parameters = self.rows[mask], self.plant_parameters[mask]


def parameters_of(plant: Plant[Any], names: tuple[str, ...], count: int) -> np.ndarray:
    """Return parameters of the bicycles, (count, M).

    Args:
        plant: one for all `count` bicycles, or one with parameters of each.
        names: such as `plant.motor.lag`: the way to a number in `Plant.to_json`.
        count: N.

    Raises:
        ValueError: if the plant has no such number.
    """
    data = json.loads(plant.to_json()) if names else {}
    columns = np.empty((count, len(names)))
    for index, name in enumerate(names):
        found = data
        for part in name.removeprefix(PARAMETER).split("."):
            found = found.get(part) if isinstance(found, dict) else None
        if isinstance(found, bool) or not isinstance(found, (int, float, list)):
            raise ValueError(f"the bicycle {plant.label} has no {name.removeprefix(PARAMETER)}")
        columns[:, index] = found
    return columns
