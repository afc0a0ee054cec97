"""Angles in words for people, who think in degrees."""

from __future__ import annotations

import math
import re

_ANGLE = re.compile(r"(-?\d+(?:\.\d+)?(?:e[+-]?\d+)?) rad(/s)?\b")


def in_degrees(text: str) -> str:
    """Return a text with each "0.5 rad" as "29°" and each "0.5 rad/s" as "29°/s"."""

    def shown(found: re.Match[str]) -> str:
        return f"{math.degrees(float(found[1])):.3g}°{found[2] or ''}"

    return _ANGLE.sub(shown, text)
