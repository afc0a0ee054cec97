"""Any ROS message as dotted names and plain values."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any

import numpy as np


def flatten(message: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the fields of a message in order.

    Args:
        message: a message of any type, or a value in one.
        prefix: dotted name of the message itself.

    Yields:
        Dotted names such as `header.stamp.sec` or `poses[0].x`, and values that are numbers,
        texts or lists of numbers.
    """
    if hasattr(message, "get_fields_and_field_types"):
        dot = f"{prefix}." if prefix else ""
        for name in message.get_fields_and_field_types():
            yield from flatten(getattr(message, name), dot + name)
    elif isinstance(message, (list, tuple)) and any(
        hasattr(item, "SLOT_TYPES") for item in message
    ):
        for index, item in enumerate(message):
            yield from flatten(item, f"{prefix}[{index}]")
    elif isinstance(message, (bytes, bytearray)):
        yield prefix, list(message)
    elif hasattr(message, "tolist"):
        yield prefix, np.asarray(message).tolist()
    else:
        yield prefix, list(message) if hasattr(message, "typecode") else message


def shown(value: Any) -> str:
    """Return a value as text; floats with all their digits."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def exact(value: Any) -> Any:
    """Return a value with each float in it as its eight bytes, to compare NaN and signed zeros."""
    if isinstance(value, float):
        return struct.pack("<d", value)
    return [exact(one) for one in value] if isinstance(value, list) else value
