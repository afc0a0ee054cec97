"""Raw data as CSV: lists of rows with the same keys, numbers where they are numbers."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student

from bicycle_controller.policy import write_atomically

Row = dict[str, Any]


def write_table(path: Path, rows: Sequence[Row]) -> None:
    """Write rows, of which every one has the keys of the first; None is an empty cell."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: _cell(value) for key, value in row.items()} for row in rows)
    write_atomically(path, text.getvalue().encode())


def read_table(path: Path) -> list[Row]:
    """What `write_table` wrote, or nothing where there is no such file.

    Raises:
        ValueError: when a line does not fit the header.
    """
    if not path.exists():
        return []
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    if any(None in row or None in row.values() for row in rows):
        raise ValueError(f"{path} has a line that does not fit its header")
    return [{key: _value(text) for key, text in row.items()} for row in rows]


def _cell(value: Any) -> Any:
    if isinstance(value, (float, np.floating)):
        return f"{value:.7g}"
    return "" if value is None else value


def _value(text: str) -> Any:
    """A number, None for nothing, or the text."""
    if text == "":
        return None
    try:
        number = float(text)
    except ValueError:
        return text
    return int(number) if number.is_integer() and "." not in text else number


def column(rows: Iterable[Row], name: str) -> np.ndarray:
    """One column's numbers, NaN where a cell is empty."""
    values = [math.nan if row[name] is None else row[name] for row in rows]
    return np.array(values, dtype=np.float64)


def interval(values: Sequence[float] | np.ndarray) -> list[float | None]:
    """[mean, low, high]: the mean of independent runs and its 95 % interval (Student's t).

    One run has no interval: low and high are None then; none at all gives three None.
    """
    array = np.asarray(values, dtype=np.float64)
    array = array[np.isfinite(array)]
    if len(array) == 0:
        return [None, None, None]
    mean = float(array.mean())
    if len(array) == 1:
        return [mean, None, None]
    half = float(student.ppf(0.975, len(array) - 1) * array.std(ddof=1) / math.sqrt(len(array)))
    return [mean, mean - half, mean + half]


def select(rows: Iterable[Row], **wanted: Any) -> list[Row]:
    """The rows with these values."""
    return [row for row in rows if all(row[key] == value for key, value in wanted.items())]


def distinct(rows: Iterable[Row], *keys: str) -> list[tuple[Any, ...]]:
    """The values of `keys` that occur, in the order of their first row."""
    return list(dict.fromkeys(tuple(row[key] for key in keys) for row in rows))
