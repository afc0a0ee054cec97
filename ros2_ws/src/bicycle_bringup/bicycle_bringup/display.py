"""Display of a ride in progress: a progress line, and a line per event."""

from __future__ import annotations

import sys
import time

from tqdm import tqdm

REDRAW = 0.1
"""Period of the progress bar (s)."""


class Display:
    """Progress bar on a terminal; elsewhere only lines.

    Args:
        goals: number of goals; zero if the time counts instead.
        seconds: duration of the ride, if the time counts.
    """

    def __init__(self, goals: int, seconds: float = 0.0) -> None:
        self._goals = goals
        self._drawn = 0.0
        self._bar = tqdm(
            total=goals or seconds,
            bar_format="{desc}{percentage:3.0f}%|{bar:20}| {elapsed}{postfix}",
            disable=None,
            leave=False,
        )

    def waiting(self, for_what: str) -> None:
        """Show the reason why the ride has not started yet."""
        self._bar.set_description_str(f"waiting for {for_what} ")

    def show(self, number: int, done: float, text: str) -> None:
        """Update the bar.

        Args:
            number: of the current goal, from 1.
            done: goals decided, or s ridden.
            text: distance left, speed and lean.
        """
        self._bar.n = min(done, float(self._bar.total))
        if time.monotonic() - self._drawn < REDRAW:
            return
        self._drawn = time.monotonic()
        of = f" of {self._goals}" if self._goals else ""
        self._bar.set_description_str(f"goal {number}{of} ", refresh=False)
        self._bar.set_postfix_str(text, refresh=False)
        self._bar.refresh()

    @staticmethod
    def say(line: str) -> None:
        """Print a line above the bar."""
        tqdm.write(line, file=sys.stdout)
        sys.stdout.flush()

    def close(self) -> None:
        """Remove the bar."""
        self._bar.close()
