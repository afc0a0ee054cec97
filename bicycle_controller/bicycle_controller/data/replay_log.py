"""The rows of a growing replay memory on the disk: appended, never written twice."""

from __future__ import annotations

from pathlib import Path

import numpy as np


class ReplayLog:
    """Rows of float32 in the order they came; a crash loses what `save` had not yet been told.

    Attributes:
        saved: rows that the last checkpoint may count on.
    """

    def __init__(self, path: Path, width: int) -> None:
        """Name the file, which need not be there, and the numbers per row."""
        self._path, self._row_bytes = path, 4 * width
        self._new: list[np.ndarray] = []
        self.saved = 0

    @property
    def rows(self) -> int:
        """All rows, saved or not."""
        return self.saved + sum(map(len, self._new))

    def add(self, rows: np.ndarray) -> None:
        """Keep rows (M, width) for the next `save`."""
        self._new.append(rows.astype(np.float32))

    def save(self) -> None:
        """Append what is new, over whatever a crash may have left behind the last save.

        Raises:
            OSError: when that fails.
        """
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with self._path.open("ab") as file:
            file.truncate(self.saved * self._row_bytes)
            for rows in self._new:
                file.write(rows.tobytes())
        self.saved, self._new = self.rows, []

    def load(self, count: int) -> np.ndarray:
        """The first `count` rows, (count, width).

        Raises:
            ValueError: when the file is not there or is too short.
        """
        try:
            data = self._path.read_bytes()[: count * self._row_bytes]
        except OSError as error:
            raise ValueError(f"cannot read {self._path}: {error.strerror}") from None
        if len(data) < count * self._row_bytes:
            raise ValueError(f"{self._path} is cut short: begin anew in another folder")
        self.saved = count
        return np.frombuffer(data, dtype=np.float32).reshape(count, self._row_bytes // 4)
