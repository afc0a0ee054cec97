"""What keeps the bicycle from being ridden, in words for a person."""

from __future__ import annotations

from typing import NamedTuple


class Line(NamedTuple):
    """What is told of a process."""

    level: str
    """good, info, warn or bad."""
    text: str
    """One line."""
    process: str = ""
    """That has died or was started again."""
    death: str = ""
    """How it died, shortly; empty where it was started again."""


class Trouble:
    """The present trouble with the processes of the ride.

    Args:
        ours: whether the cockpit started simulator and controller, and starts them again.
    """

    def __init__(self, ours: bool) -> None:
        self._ours = ours
        self._deaths: dict[str, str] = {}
        self._starting: set[str] = set()

    def told(self, line: Line) -> None:
        """A process has died, or was started again."""
        if line.death:
            self._deaths[line.process] = line.death
            self._starting.discard(line.process)
        elif line.process:
            self._starting.add(line.process)

    def heard(self, process: str) -> None:
        """It speaks; what still comes of one that has died does not count."""
        if process in self._starting:
            self._starting.remove(process)
            self._deaths.pop(process, None)

    def now(self, hears_simulator: bool, controllers: int) -> str:
        """What is missing and what is done about it; nothing where all is there.

        Args:
            hears_simulator: states arrive.
            controllers: that publish commands; one that was killed is counted for a while.
        """
        remedy = "the cockpit starts it"
        if self._deaths:
            return "; ".join(f"{death}: {remedy}" for death in self._deaths.values())
        if hears_simulator and controllers:
            return ""
        what = "no controller runs" if hears_simulator else "no simulator is heard"
        script = "controller.sh" if hears_simulator else "sim.sh"
        return f"{what}: {remedy if self._ours else f'start ros2_ws/{script}'}"
