"""Raw data as CSV: lists of rows with equal keys; numeric text becomes numbers."""

from __future__ import annotations

import csv
import io
import itertools
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bicycle_common.validation import require
from bicycle_controller.evaluation.evaluate import wilson
from bicycle_controller.policy.policy import write_atomically

EXACT, RESAMPLES = 5, 10_000
"""Largest number of runs of which every sample is drawn, and number of samples for more runs."""
Row = dict[str, Any]


def write_table(path: Path, rows: Sequence[Row]) -> None:
    """Write rows, which all have the keys of the first; None becomes an empty cell."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: _cell(value) for key, value in row.items()} for row in rows)
    write_atomically(path, text.getvalue().encode())


def read_table(path: Path) -> list[Row]:
    """Return the rows that `write_table` wrote; empty if there is no such file.

    Raises:
        ValueError: if a line does not fit the header.
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
    """Parse a number, None for an empty cell, or the text."""
    if text == "":
        return None
    try:
        number = float(text)
    except ValueError:
        return text
    return int(number) if number.is_integer() and "." not in text else number


def column(rows: Iterable[Row], name: str) -> np.ndarray:
    """Return the numbers of one column, NaN for empty cells."""
    values = [math.nan if row[name] is None else row[name] for row in rows]
    return np.array(values, dtype=np.float64)


def interval(values: Sequence[float] | np.ndarray) -> list[float | None]:
    """Return [mean, low, high]: the mean of independent runs and its 95 % bootstrap interval.

    The interval spans the 2.5 to the 97.5 percentile of the means of all samples drawn from the
    runs with replacement; of two or three runs it spans the least to the largest. It never leaves
    the observed range, so no share exceeds 1 and no return exceeds 0.

    One run has no interval: low and high are None; no run at all gives three None.
    """
    array = np.asarray(values, dtype=np.float64)
    array = array[np.isfinite(array)]
    if len(array) == 0:
        return [None, None, None]
    mean = float(array.mean())
    if len(array) == 1:
        return [mean, None, None]
    means = array[_resamples(len(array))].mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975], method="inverted_cdf")
    return [mean, min(float(low), mean), max(float(high), mean)]


def _resamples(runs: int) -> np.ndarray:
    """Return indices (samples, runs): every sample if there are few, else RESAMPLES of them."""
    if runs <= EXACT:
        return np.array(list(itertools.product(range(runs), repeat=runs)))
    return np.random.default_rng(0).integers(runs, size=(RESAMPLES, runs))


def share(hits: Sequence[int] | np.ndarray, counts: Sequence[int] | np.ndarray) -> list[float]:
    """Return [mean, low, high] of the shares `hits` of `counts`, one of each per run.

    The interval contains both the one over the runs (`interval`) and Wilson's over all counts:
    the first reflects differences between runs, the second that 0 in 100 is not never.

    Raises:
        ValueError: unless there is a run, and 0 <= hits <= count in each.
    """
    require(len(hits) > 0, "no run, no share")
    by_run = np.divide(hits, counts)
    mean = float(by_run.mean())
    _, low, high = interval(by_run)
    ends = [*wilson(int(np.sum(hits)), int(np.sum(counts))), low, high]
    known = [end for end in ends if end is not None]
    return [mean, min(*known, mean), max(*known, mean)]


def select(rows: Iterable[Row], **wanted: Any) -> list[Row]:
    """Return the rows with these values."""
    return [row for row in rows if all(row[key] == value for key, value in wanted.items())]


def distinct(rows: Iterable[Row], *keys: str) -> list[tuple[Any, ...]]:
    """Return the distinct values of `keys`, in the order of their first row."""
    return list(dict.fromkeys(tuple(row[key] for key in keys) for row in rows))
