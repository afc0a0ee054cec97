"""Number formats of RESULTS.md."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any


def percent(share: float) -> str:
    """Return a share of 0 to 1 in percent, with more digits near the ends."""
    value = 100.0 * share
    whole = value in (0.0, 100.0)
    return f"{value:.0f} %" if whole or 1.0 <= value <= 99.0 else f"{value:.1f} %"


def rate(values: Sequence[float]) -> str:
    """Format [share, low, high] with its interval."""
    share, low, high = (100.0 * value for value in values)
    return f"{share:.1f} % ({low:.1f} to {high:.1f})"


def mean(values: Sequence[float | None], factor: float = 1.0, unit: str = "") -> str:
    """Format [mean, low, high] with the interval if there is one."""
    middle, low, high = values
    if middle is None:
        return "-"
    text = f"{number(factor * middle)}{unit}"
    if low is None or high is None:
        return text
    return f"{text} ({number(factor * low)} to {number(factor * high)})"


def number(value: float) -> str:
    """Format about three digits, with the paper's minus sign."""
    size = abs(value)
    digits = 0 if size >= 100.0 else 1 if size >= 10.0 else 2
    text = f"{value:,.{digits}f}"
    return text.replace("-", "−")


def lengths(entry: Mapping[str, Any]) -> str:
    """Return the length of an arm's runs in full episodes: one number, or a range."""
    shortest, longest = f"{entry['length']:,.0f}", f"{entry['longest']:,.0f}"
    return shortest if shortest == longest else f"{shortest} to {longest}"
