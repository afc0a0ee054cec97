"""Which quantities change sign between the paper's convention and REP-103's, and nothing else.

Inside, the paper's: lean omega > 0 to the left, psi_g > 0 for a goal to the right. In messages,
REP-103: roll > 0 to the right, heading error > 0 for a goal to the left. Negation is exact and
its own inverse, so one function serves both ways, for numbers and for whole columns of a bag.
"""

from __future__ import annotations

from typing import Any

MIRRORED = frozenset(("lean_angle", "lean_rate", "lean_acceleration", "heading_error"))
"""Names of the quantities that are negated."""


def mirror(name: str, value: Any) -> Any:
    """The quantity `name` in the other convention; a number or an array."""
    return -value if name in MIRRORED else value
