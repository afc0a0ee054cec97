"""Runs and bags as CSV, for spreadsheets and pandas."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bicycle_bag.columns import load
from bicycle_common import topic_names
from bicycle_common.validation import nearest

LOG = "log.jsonl"
STATE = topic_names.in_bag(topic_names.STATE)

Table = tuple[list[str], Iterable[Sequence[Any]]]
"""Names of the columns, and the rows."""


def table_of(path: Path, topic: str | None = None) -> Table:
    """Return a run's log, or one topic of a bag.

    Args:
        path: the folder of a run, or a bag.
        topic: of a bag; its states by default.

    Raises:
        ValueError: if it is neither, or the bag lacks the topic.
    """
    if (path / LOG).is_file():
        if topic is not None:
            raise ValueError(f"{path} is a run, which has no topics: leave out --topic")
        return _run_table(path / LOG)
    if not ((path / "metadata.yaml").is_file() or path.suffix == ".mcap"):
        raise ValueError(
            f"{path} is neither the folder of a run (with {LOG}) nor a bag (with metadata.yaml)"
        )
    return _bag_table(path, topic or STATE)


def _run_table(path: Path) -> Table:
    rows = []
    for line in path.read_text().splitlines():
        try:
            rows.append(json.loads(line))
        except ValueError:
            continue  # a line that a kill has cut
    names = list(dict.fromkeys(name for row in rows for name in row))
    return names, ([row.get(name) for name in names] for row in rows)


def _bag_table(path: Path, topic: str) -> Table:
    from bicycle_bag.reader import BagReader

    bag = BagReader(path)
    names = {name.lstrip("/"): name for name in bag.topics}
    if topic.lstrip("/") not in names:
        known = ", ".join(sorted(names))
        hint = nearest(topic.lstrip("/"), names)
        raise ValueError(f"{path} has no topic {topic}{hint}; it has {known}")
    columns = dict(_flat(load(bag, names[topic.lstrip("/")])))
    return list(columns), zip(*(values.tolist() for values in columns.values()), strict=True)


def _flat(columns: dict[str, np.ndarray]) -> Iterator[tuple[str, np.ndarray]]:
    """Yield a column for each number; a field of variable length becomes JSON."""
    for name, values in columns.items():
        if values.ndim == 2:
            for index, column in enumerate(values.T):
                yield f"{name}[{index}]", column
        elif values.dtype == object:
            yield name, np.array([_cell(value) for value in values], dtype=object)
        else:
            yield name, values


def _cell(value: Any) -> Any:
    return json.dumps(np.asarray(value).tolist()) if not isinstance(value, str) else value


def write(table: Table, path: Path) -> int:
    """Write a table; return its number of rows.

    Raises:
        OSError: if that fails.
    """
    names, rows = table
    path.parent.mkdir(parents=True, exist_ok=True)
    count = 0
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        for row in rows:
            writer.writerow(["" if value is None else value for value in row])
            count += 1
    return count
