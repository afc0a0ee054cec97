"""Estimates at the last instants, for readings that come late."""

from __future__ import annotations

import numpy as np


class History:
    """A ring of estimates (N, k) and their times."""

    def __init__(self, length: int, shape: tuple[int, int]) -> None:
        """Begin empty.

        Args:
            length: number of estimates that are kept.
            shape: (N, k) of each.
        """
        self._length = length
        # Twice as long as needed: what is kept stays in one piece and moves seldom.
        self._times = [0.0] * (2 * length)
        self._states = np.zeros((2 * length, *shape))
        self._first = self._end = 0

    def clear(self) -> None:
        """Forget everything."""
        self._first = self._end = 0

    def add(self, time: float, state: np.ndarray) -> None:
        """Keep a copy of `state` (N, k), of a time later than the last."""
        if self._end == len(self._times):
            kept = slice(self._length + 1, self._end)
            self._end = self._length - 1
            self._times[: self._end] = self._times[kept]
            self._states[: self._end] = self._states[kept]
            self._first = 0
        self._times[self._end] = time
        self._states[self._end] = state
        self._end += 1
        self._first = max(self._first, self._end - self._length)

    def at(self, time: float) -> np.ndarray:
        """Interpolate the values (N, k) at a time; the oldest or newest beyond these.

        The answer may change with the next call of another method.
        """
        index = self._after(time)
        if index == self._end:
            return self._states[index - 1]
        if index == self._first:
            return self._states[index]
        begun, ended = self._times[index - 1], self._times[index]
        share = (time - begun) / (ended - begun)
        if share >= 1.0:
            return self._states[index]
        found: np.ndarray = (1.0 - share) * self._states[index - 1] + share * self._states[index]
        return found

    def correct(self, time: float, change: np.ndarray) -> None:
        """Add `change` (N, k) to what was estimated at `time` and later."""
        index = self._after(time)
        if index < self._end:
            self._states[index : self._end] += change

    def _after(self, time: float) -> int:
        """Index of the first entry that is not before `time`."""
        index = self._end
        while index > self._first and self._times[index - 1] >= time - 1e-9:
            index -= 1
        return index
