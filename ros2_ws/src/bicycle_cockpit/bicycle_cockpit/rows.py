"""Numbered rows of a ride for the pages, so that none is shown twice or missed."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import NamedTuple

from bicycle_cockpit.samples import plain_row


class Rows(NamedTuple):
    """Consecutive rows of one ride."""

    ride: int
    """Number of the simulator's start; rows are numbered anew with each."""
    first: int
    """Number of the first row; the rows of a ride count from 0."""
    texts: tuple[str, ...]
    """Each row as JSON."""

    @property
    def end(self) -> int:
        """Number of the row after the last one."""
        return self.first + len(self.texts)

    def message(self, kind: str) -> str:
        """Return the message for a page: `frame` for new rows, `history` for older ones."""
        rows = ",".join(self.texts)
        return f'{{"type":"{kind}","ride":{self.ride},"first":{self.first},"rows":[{rows}]}}'


def row_text(values: Iterable[float]) -> str:
    """Return one row as JSON."""
    return json.dumps(plain_row(values), allow_nan=False, separators=(",", ":"))


def joined(parts: Iterable[Rows]) -> Rows:
    """Join consecutive rows.

    Raises:
        ValueError: if there are none, or they are not consecutive.
    """
    waiting = list(parts)
    if not waiting:
        raise ValueError("there are no rows to join")
    texts: list[str] = []
    for part in waiting:
        if part.ride != waiting[0].ride or part.first != waiting[0].first + len(texts):
            raise ValueError("the rows do not follow one another")
        texts += part.texts
    return Rows(waiting[0].ride, waiting[0].first, tuple(texts))
