"""Messages of an earlier version of their type: zeros for the fields that it has got since.

A new version of one of our messages adds fields at its end, where zero and empty mean what an
earlier one meant. CDR has no place for what is left out, so a message of the earlier version is
cut short to whoever knows the new one; bytes beyond a message's end are read by nobody.
"""

from __future__ import annotations

from bicycle_bag.errors import BagError
from bicycle_bag.schemas import PRIMITIVES, SEPARATOR, Schemas, fields

_WIDEST = 8
"""Bytes of the widest number, to which it is aligned."""


def missing_fields(type_name: str, recorded: str, schemas: Schemas) -> list[str]:
    """Return the names of the installed type's fields that a recorded definition lacks.

    Args:
        type_name: as pkg/msg/Type.
        recorded: the definition in the bag.
        schemas: of what is installed.
    """
    try:
        installed = schemas.definition(type_name)
    except BagError:
        return []
    old, new = (_names(text) for text in (recorded, installed))
    return [name for name in new if name not in old]


def _names(definition: str) -> list[str]:
    return [field.name for field in fields(definition.partition(SEPARATOR)[0])]


def missing_end(type_name: str, recorded: str, schemas: Schemas) -> bytes:
    """Return the bytes that complete a recorded message to the installed version of its type.

    Args:
        type_name: as pkg/msg/Type.
        recorded: the definition in the bag.
        schemas: of what is installed.

    Returns:
        Zeros; nothing where the type is the same, unknown, or has changed in another way.
    """
    try:
        installed = schemas.definition(type_name)
    except BagError:
        return b""
    old, new = (list(fields(text.partition(SEPARATOR)[0])) for text in (recorded, installed))
    added = new[len(old) :]
    simple = all(f.type in PRIMITIVES and not f.array[1:-1].isdigit() for f in added)
    if not old or old != new[: len(old)] or not added or not simple:
        return b""
    return bytes(_WIDEST * (len(added) + 1))
