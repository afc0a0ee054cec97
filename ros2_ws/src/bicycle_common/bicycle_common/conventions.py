"""Quantities whose sign differs between the paper's convention and REP-103.

The code uses the paper's signs: lean omega > 0 to the left, psi_g > 0 for a goal to the right; a
pitch is positive with the nose up. Messages use REP-103: roll > 0 to the right, pitch > 0 with the
nose down, heading error > 0 for a goal to the left. Negation is exact and its own inverse, so one
function converts both ways, for numbers and bag columns.
"""

from __future__ import annotations

from typing import Any

MIRRORED = frozenset(("lean_angle", "lean_rate", "lean_acceleration", "heading_error", "pitch"))
"""Names of the negated quantities."""


def mirror(name: str, value: Any) -> Any:
    """Return the quantity `name` in the other convention; a number or an array."""
    return -value if name in MIRRORED else value
