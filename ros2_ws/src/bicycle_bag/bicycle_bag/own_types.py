"""Check of a bag's definitions of this project's own types, whose fields are read by name.

A definition that is installed here under the same name, but lacks a field that every release
recorded, is of no release: a field of it was renamed, or another project has a type of that name.
"""

from __future__ import annotations

from functools import cache

from bicycle_bag.errors import BagError
from bicycle_bag.schemas import SEPARATOR, Schemas, fields

OURS = "bicycle_msgs/msg/"
"""Package of the types that are checked."""
ADDED = {
    f"{OURS}BicycleCommand": {"heading_error", "goal_distance"},
    f"{OURS}BicycleState": {"yaw_rate", "pitch", "estimated", "plant_state"},
}
"""Fields that a later release added: a bag of an earlier one lacks them."""


def check_definition(topic: str, type_name: str, definition: str) -> None:
    """Check that a definition has the fields that every release has recorded.

    Args:
        topic: its name, for the error.
        type_name: as pkg/msg/Type; one of another package is not checked.
        definition: in the bag; an empty one is not checked.

    Raises:
        BagError: if a field is missing.
    """
    if not type_name.startswith(OURS) or not definition:
        return
    there = {field.name for field in fields(definition.split(SEPARATOR, 1)[0])}
    missing = sorted(_required(type_name) - there)
    if missing:
        raise BagError(
            f"{topic}: the bag's definition of {type_name} lacks {', '.join(missing)}, which "
            "every release has: it was recorded with another type of that name"
        )


@cache
def _required(type_name: str) -> frozenset[str]:
    """Return the fields that every release has recorded; none of a type that is not installed."""
    try:
        definition = Schemas().definition(type_name)
    except BagError:
        return frozenset()
    names = {field.name for field in fields(definition.split(SEPARATOR, 1)[0])}
    return frozenset(names - ADDED.get(type_name, set()))
