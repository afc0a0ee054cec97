"""JSON of others: whatever the text is, a `ValueError` is all that it can cause."""

from __future__ import annotations

import json
from typing import Any


def parse(text: str | bytes) -> Any:
    """Return the plain data of a JSON text.

    Raises:
        ValueError: on other text, or where it is nested too deeply to be read.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
