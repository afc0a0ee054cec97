"""Estimates at the last instants, for readings that come late."""

from __future__ import annotations

import numpy as np


class History:
    """A ring of estimates (N, k) and their times."""

    def __init__(self, length: int) -> None:
        self._length = length
        self._times: list[float] = []
        self._states: list[np.ndarray] = []

    def clear(self) -> None:
        """Forget everything."""
        self._times.clear()
        self._states.clear()

    def add(self, time: float, state: np.ndarray) -> None:
        """Keep `state` (N, k), which the caller changes no more, of a time later than the last."""
        self._times.append(time)
        self._states.append(state)
        if len(self._times) > self._length:
            del self._times[0], self._states[0]

    def at(self, time: float) -> np.ndarray:
        """Interpolate the values (N, k) at a time; the oldest or newest beyond these."""
        index = self._after(time)
        if index == len(self._times):
            return self._states[-1]
        if index == 0:
            return self._states[0]
        begun, ended = self._times[index - 1], self._times[index]
        share = (time - begun) / (ended - begun)
        if share >= 1.0:
            return self._states[index]
        return (1.0 - share) * self._states[index - 1] + share * self._states[index]

    def correct(self, time: float, change: np.ndarray) -> None:
        """Add `change` (N, k) to what was estimated at `time` and later."""
        for index in range(self._after(time), len(self._states)):
            self._states[index] = self._states[index] + change

    def _after(self, time: float) -> int:
        """Index of the first entry that is not before `time`."""
        index = len(self._times)
        while index > 0 and self._times[index - 1] >= time - 1e-9:
            index -= 1
        return index
