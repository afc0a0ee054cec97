"""Strange values for every field of any ROS message, found from the message's own definition."""

from __future__ import annotations

import copy
import importlib
import math
import re
from collections.abc import Iterator
from typing import Any

from hypothesis import strategies as st

FLOATS = (
    *(math.nan, math.inf, -math.inf, 5e-324, -5e-324, 2.2e-308, -0.0, 1.0),
    *(1e-9, -1.0, math.pi, 1e4, -1e6, 1e300, -1.7976931348623157e308),
)
TEXTS = ("", "odom", "base_link", "x" * 10_000, "two\nlines", "{}", "[]", "null", "ö�", "nan")
LISTS = (0, 1, 3, 10_001)
"""Lengths of unbounded lists of messages."""


def values(kind: str) -> list[Any]:
    """Strange values of a field of a primitive type, as `get_fields_and_field_types` names it."""
    if kind in ("float", "double"):
        return list(FLOATS)
    if kind == "boolean":
        return [False, True]
    if kind == "octet":
        return [b"\x00", b"\xff"]
    if kind.startswith("string"):
        return list(TEXTS)
    signed, bits = re.fullmatch(r"(u?)int(\d+)", kind).groups()  # type: ignore[union-attr]
    low, high = (0, 2 ** int(bits) - 1) if signed else (-(2 ** (int(bits) - 1)), 0)
    high = high or 2 ** (int(bits) - 1) - 1
    return sorted({low, 0, 1, 7, high - 1, high})


def leaves(
    message: Any, path: tuple[Any, ...] = ()
) -> Iterator[tuple[tuple[Any, ...], list[Any]]]:
    """Every field, however deep, with its strange values; fixed arrays element by element."""
    for name, kind in message.get_fields_and_field_types().items():
        here = (*path, name)
        fixed = re.fullmatch(r"(\w+)\[(\d+)\]", kind)
        many = re.fullmatch(r"sequence<([\w/]+)(?:, \d+)?>", kind)
        if fixed:
            for index in range(int(fixed[2])):
                yield (*here, index), values(fixed[1])
        elif many and "/" in many[1]:
            package, name_of_type = many[1].split("/")
            one = getattr(importlib.import_module(f"{package}.msg"), name_of_type)
            yield here, [[one() for _ in range(length)] for length in LISTS]
            for index in range(len(getattr(message, name))):
                yield from leaves(getattr(message, name)[index], (*here, index))
        elif many:
            yield here, [[value] for value in values(many[1])]
        elif "/" in kind:
            yield from leaves(getattr(message, name), here)
        else:
            yield here, values(kind)


def changed(message: Any, path: tuple[Any, ...], value: Any) -> Any:
    """Return a copy of a message with one field set."""
    result = copy.deepcopy(message)
    holder = result
    for part in path[:-1]:
        holder = holder[part] if isinstance(part, int) else getattr(holder, part)
    if isinstance(path[-1], int):
        holder[path[-1]] = value
    else:
        setattr(holder, path[-1], value)
    return result


def each_field(message: Any) -> Iterator[Any]:
    """Copies of a message with each field in turn at each of its strange values."""
    for path, strange in leaves(message):
        for value in strange:
            yield changed(message, path, value)


@st.composite
def several_fields(draw: st.DrawFn, message: Any) -> Any:
    """Copies of a message with any fields at any of their strange values."""
    found = list(leaves(message))
    result = message
    for path, strange in draw(st.lists(st.sampled_from(found), min_size=1, max_size=6)):
        try:
            result = changed(result, path, draw(st.sampled_from(strange)))
        except IndexError:  # a list that has been replaced by a shorter one
            continue
    return result
