"""Readings on their way: which of them have arrived at which bicycle."""

from __future__ import annotations

import numpy as np

from bicycle_controller.estimation.kalman import MEMORY
from bicycle_sim.sensors.reading import ORDER, Reading


class Arrivals:
    """Holds readings of N bicycles back until they have arrived."""

    def __init__(self) -> None:
        self._waiting: list[tuple[Reading, np.ndarray]] = []

    def add(self, readings: list[Reading]) -> None:
        """Take readings that were measured; those that are lost never arrive."""
        self._waiting += [(reading, ~reading.lost) for reading in readings]

    def due(self, now: float) -> list[tuple[Reading, np.ndarray]]:
        """Return readings and masks (N,) of the bicycles that they have reached, once each."""
        found, left = [], []
        for reading, missing in self._waiting:
            arrived = missing & (reading.arrival <= now + 1e-9)
            if arrived.any():
                found.append((reading, arrived))
            still = missing & ~arrived
            if still.any() and reading.stamp > now - MEMORY:
                left.append((reading, still))
        self._waiting = left
        return sorted(found, key=lambda one: (one[0].stamp, ORDER.index(one[0].sensor)))
