"""Two regulators for each of N bicycles: one that catches kicks, and a calm one for the rest."""

from __future__ import annotations

import numpy as np

from bicycle_controller.config.imitation import CalmConfig
from bicycle_controller.training.teachers import Seen, Teachers

LEAST_KICK = 0.05
"""rad/s that counts as caught, where nothing is."""


class CalmTeachers:
    """N pairs of regulators, which answer as `Teachers` does."""

    def __init__(
        self, config: CalmConfig, calm: Teachers, quick: Teachers, caught: np.ndarray
    ) -> None:
        """Join them.

        Args:
            config: when which of them rides.
            calm: rides while nothing pushes.
            quick: catches kicks.
            caught: (S, N) rad/s that `quick` catches at its speeds.
        """
        self.config, self.calm, self.quick = config, calm, quick
        self._caught = np.maximum(caught, LEAST_KICK)
        self._rows = np.arange(caught.shape[1])

    def act(self, seen: Seen) -> np.ndarray:
        """Return the torques, (N,) N m."""
        lean, lean_rate, steer, _, error, speed, _, _ = seen
        own = self.config
        pushed = np.abs(lean_rate + own.pull * (lean - self.calm.wanted_lean(steer, error, speed)))
        speeds = self.quick.speeds
        nearest = np.interp(speed, speeds, np.arange(len(speeds))).round().astype(np.intp)
        part = pushed / self._caught[nearest, self._rows]
        share = np.clip((part - own.begin) / (own.end - own.begin), 0.0, 1.0)
        torque: np.ndarray = (1.0 - share) * self.calm.act(seen) + share * self.quick.act(seen)
        return torque
