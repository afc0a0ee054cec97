"""What a ride shows meanwhile: a line of progress, and a line for each thing that happens."""

from __future__ import annotations

import sys
import time

from tqdm import tqdm

REDRAW = 0.1
"""s between two looks of the progress bar."""


class Display:
    """A progress bar on a terminal; elsewhere only the lines.

    Args:
        goals: how many there are; zero where the time counts instead.
        seconds: how long the ride lasts, where the time counts.
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
        """Show what keeps the ride from beginning."""
        self._bar.set_description_str(f"waiting for {for_what} ")

    def show(self, number: int, done: float, text: str) -> None:
        """Bring the bar up to date.

        Args:
            number: of the present goal, from 1.
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
