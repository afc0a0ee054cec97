"""Messages from YAML, as `ros2 topic pub` and `ros2 service call` accept them."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any

from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractString,
    AbstractWString,
    Array,
    BasicType,
    BoundedSequence,
    NamespacedType,
)

from bicycle_common import yaml_text
from bicycle_common.validation import nearest

FLOATS = ("float", "double", "long double")
WHOLE = {
    **{f"int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"uint{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
    "octet": (0, 255),
    "char": (0, 255),
}
"""Least and largest value of each integer type."""


class FillingError(ValueError):
    """Values that do not fit a message; the text is one line."""


def filled(kind: type[Any], text: str) -> Any:
    """Return a message, or a service's request, with the values of a YAML text.

    Args:
        kind: class of the message.
        text: a mapping such as `{position: {x: 1.0}}`; empty leaves every default.

    Raises:
        FillingError: if the text is not YAML, or a value does not fit its field.
    """
    try:
        values = yaml_text.load(text) if text.strip() else {}
    except yaml_text.YAMLError as error:
        raise FillingError(f"{text[:60]!r} is not YAML: {' '.join(str(error).split())}") from None
    message = kind()
    _fill(message, values, "")
    return message


def _fill(message: Any, values: Any, place: str) -> None:
    name = type(message).__name__
    if not isinstance(values, Mapping):
        raise FillingError(f"{place or name} must be fields, as {{a: 1}}, not {values!r}")
    fields = list(message.get_fields_and_field_types())
    types = dict(zip(fields, message.SLOT_TYPES, strict=True))
    for field, value in values.items():
        if field not in types:
            hint = nearest(str(field), fields)
            known = ", ".join(fields) or "none"
            raise FillingError(f"{place or name} has no field {field!r}{hint}; it has {known}")
        inner = f"{place}.{field}" if place else str(field)
        old = getattr(message, field)
        setattr(message, field, _value(types[field], value, old, inner))


def _value(kind: Any, value: Any, old: Any, place: str) -> Any:
    """Return a value converted to the type of its field."""
    if isinstance(kind, AbstractNestedType):
        return _values(kind, value, place)
    if isinstance(kind, NamespacedType):
        message = old if old is not None else _class_of(kind)()
        _fill(message, value, place)
        return message
    if isinstance(kind, (AbstractString, AbstractWString)):
        if not isinstance(value, str):
            raise FillingError(f"{place} must be a text, not {value!r}: put it in quotes")
        return value
    assert isinstance(kind, BasicType)
    return _number(kind.typename, value, place)


def _values(kind: AbstractNestedType, value: Any, place: str) -> list[Any]:
    if not isinstance(value, list):
        raise FillingError(f"{place} must be a list, as [1, 2], not {value!r}")
    if isinstance(kind, Array) and len(value) != kind.size:
        raise FillingError(f"{place} must have {kind.size} values, not {len(value)}")
    if isinstance(kind, BoundedSequence) and len(value) > kind.maximum_size:
        raise FillingError(f"{place} has {len(value)} values: {kind.maximum_size} are the most")
    return [
        _value(kind.value_type, item, None, f"{place}[{index}]")
        for index, item in enumerate(value)
    ]


def _number(kind: str, value: Any, place: str) -> Any:
    if kind == "boolean":
        if not isinstance(value, bool):
            raise FillingError(f"{place} must be true or false, not {value!r}")
        return value
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if kind in FLOATS:
        if not number:
            raise FillingError(f"{place} must be a number, not {value!r}")
        try:
            return float(value)
        except OverflowError:
            raise FillingError(f"{place} is beyond what a {kind} holds") from None
    low, high = WHOLE[kind]
    if not (number and isinstance(value, int) and low <= value <= high):
        raise FillingError(f"{place} must be a whole number from {low} to {high}, not {value!r}")
    return bytes([value]) if kind == "octet" else value


def _class_of(kind: NamespacedType) -> type[Any]:
    module = importlib.import_module(".".join(kind.namespaces))
    found: type[Any] = getattr(module, kind.name)
    return found
