"""Rows of a growing replay memory on the disk: appended, never rewritten."""

from __future__ import annotations

from pathlib import Path

import numpy as np


class ReplayLog:
    """Rows of float32 in the order of arrival; a crash loses those after the last `save`.

    Attributes:
        saved: number of rows guaranteed to the last checkpoint.
    """

    def __init__(self, path: Path, width: int) -> None:
        """Set the path, which need not exist, and the width of a row."""
        self._path, self._row_bytes = path, 4 * width
        self._new: list[np.ndarray] = []
        self.saved = 0

    @property
    def rows(self) -> int:
        """Number of rows, saved or not."""
        return self.saved + sum(map(len, self._new))

    def add(self, rows: np.ndarray) -> None:
        """Keep rows (M, width) for the next `save`."""
        self._new.append(rows.astype(np.float32))

    def save(self) -> None:
        """Append the new rows, over any remains of a crash after the last save.

        Raises:
            OSError: if that fails.
        """
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with self._path.open("ab") as file:
            file.truncate(self.saved * self._row_bytes)
            for rows in self._new:
                file.write(rows.tobytes())
        self.saved, self._new = self.rows, []

    def load(self, count: int) -> np.ndarray:
        """Return the first `count` rows, (count, width).

        Raises:
            ValueError: if the file is missing or too short.
        """
        try:
            data = self._path.read_bytes()[: count * self._row_bytes]
        except OSError as error:
            raise ValueError(f"cannot read {self._path}: {error.strerror}") from None
        if len(data) < count * self._row_bytes:
            raise ValueError(f"{self._path} is cut short: begin anew in another folder")
        self.saved = count
        return np.frombuffer(data, dtype=np.float32).reshape(count, self._row_bytes // 4)
