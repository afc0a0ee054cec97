"""Clocks that stand still until a test moves them on."""

from __future__ import annotations


class Clock:
    """Clock in seconds, as `time.monotonic`."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


class NanosecondClock:
    """Clock in nanoseconds, as `time.monotonic_ns`."""

    def __init__(self) -> None:
        self.now = 5_000_000_000

    def __call__(self) -> int:
        return self.now
