"""The flat layout of a message type, from the definition that a bag carries."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bicycle_bag.schemas import INTEGERS, PRIMITIVES, SEPARATOR, Field, fields

_DTYPES = {
    **{name: np.dtype(name).newbyteorder("<") for name in (*INTEGERS, "float32", "float64")},
    "bool": np.dtype(np.bool_),
    "byte": np.dtype(np.uint8),
    "char": np.dtype(np.uint8),
}
MAX_DEPTH = 32


class Leaf(NamedTuple):
    """A number, a string or an array of numbers within a message.

    `length` is the number of elements, `None` where each message has its own.
    """

    name: str
    dtype: np.dtype[np.generic]
    length: int | None
    is_string: bool = False
    is_scalar: bool = False

    @property
    def shape(self) -> tuple[int, ...]:
        """Return the shape of a value that no message determines."""
        return () if self.is_scalar or self.is_string else (self.length or 0,)


def layout(type_name: str, definition: str) -> list[Leaf]:
    """Return the leaves of a type in the order in which CDR holds them.

    Args:
        type_name: `pkg/msg/Type` of the definition's first part.
        definition: `ros2msg` text with all dependencies.

    Raises:
        ValueError: The text lacks a type, or holds arrays of messages or strings.
    """
    package, _, short = type_name.rpartition("/")
    root = f"{package.removesuffix('/msg')}/{short}"
    parts = definition.split(f"\n{SEPARATOR}\n")
    texts = {root: parts[0]}
    for part in parts[1:]:
        head, _, text = part.partition("\n")
        texts[head.removeprefix("MSG:").strip().replace("/msg/", "/")] = text
    if not definition:
        raise ValueError("the bag has no definition of it")
    leaves: list[Leaf] = []
    _append(root, "", texts, leaves, 0)
    return leaves


def _append(name: str, prefix: str, texts: dict[str, str], leaves: list[Leaf], depth: int) -> None:
    if name not in texts or depth > MAX_DEPTH:
        raise ValueError(f"no definition of {name}")
    found = list(fields(texts[name]))
    if not found:  # CDR holds one byte of an empty message
        leaves.append(Leaf(f"{prefix}structure_needs_at_least_one_member", _DTYPES["byte"], 1))
    for field in found:
        if field.type in PRIMITIVES:
            leaves.append(_leaf(field, prefix))
        elif field.array:
            raise ValueError(f"{prefix}{field.name} is an array of {field.type}")
        else:
            package = name.split("/")[0]
            nested = field.type if "/" in field.type else f"{package}/{field.type}"
            nested = nested.replace("/msg/", "/")
            _append(nested, f"{prefix}{field.name}.", texts, leaves, depth + 1)


def _leaf(field: Field, prefix: str) -> Leaf:
    name = f"{prefix}{field.name}"
    if field.type == "wstring" or (field.type == "string" and field.array):
        raise ValueError(f"{name} is {field.type}{field.array}")
    if field.type == "string":
        return Leaf(name, _DTYPES["byte"], None, is_string=True)
    dtype = _DTYPES[field.type]
    if not field.array:
        return Leaf(name, dtype, 1, is_scalar=True)
    inside = field.array.strip("[]")
    return Leaf(name, dtype, int(inside) if inside.isdecimal() else None)
