"""Numbers by which Nav2's actions say why an order was not carried out.

Each release's results have constants of their own. In Jazzy only those of FollowPath do: there,
Nav2's navigator hands on FollowPath's number as its own, and so does this one.
"""

from __future__ import annotations

from typing import Any

INVALID_PATH = ("INVALID_PATH", "UNKNOWN")
"""A path cannot be ridden."""
LOST = ("FAILED_TO_MAKE_PROGRESS", "UNKNOWN")
"""The bicycle lost its path, or took too long on it."""
LATE = ("TIMEOUT", "FAILED_TO_MAKE_PROGRESS", "UNKNOWN")
"""A goal was not reached in time."""
OTHER = ("UNKNOWN",)
"""Anything else."""


def number(names: tuple[str, ...], *results: Any) -> int:
    """Return the number of the first name that is known.

    Args:
        names: constants, the most telling first.
        results: result of the action, then what to take the constants from if it has none.

    Raises:
        LookupError: if no result has a constant of these names.
    """
    for result in results:
        for name in names:
            found = getattr(result, name, None)
            if found is not None:
                return int(found)
    raise LookupError(f"nav2_msgs has no constant {' or '.join(names)}")
