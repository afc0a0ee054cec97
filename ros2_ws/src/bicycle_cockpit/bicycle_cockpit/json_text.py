"""JSON that every browser reads."""

from __future__ import annotations

import json
from typing import Any


def json_text(data: dict[str, Any]) -> str:
    """Return JSON without NaN and without spaces.

    Raises:
        ValueError: on a number that is not finite.
    """
    return json.dumps(data, allow_nan=False, separators=(",", ":"))
