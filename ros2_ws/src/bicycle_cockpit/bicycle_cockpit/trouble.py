"""Obstacles to riding the bicycle, in words for the user."""

from __future__ import annotations

from typing import NamedTuple


class Line(NamedTuple):
    """Message about a process."""

    level: str
    """good, info, warn or bad."""
    text: str
    """Description in one line."""
    process: str = ""
    """Process that has died or was restarted."""
    death: str = ""
    """Short cause of the death; empty if it was restarted."""


class Trouble:
    """Current trouble with the processes of the ride.

    Args:
        ours: True if the cockpit started simulator and controller, and restarts them.
    """

    def __init__(self, ours: bool) -> None:
        self._ours = ours
        self._deaths: dict[str, str] = {}
        self._starting: set[str] = set()

    def told(self, line: Line) -> None:
        """Note that a process has died, or was restarted."""
        if line.death:
            self._deaths[line.process] = line.death
            self._starting.discard(line.process)
        elif line.process:
            self._starting.add(line.process)

    def heard(self, process: str) -> None:
        """Note that it speaks; late messages of a dead process do not count."""
        if process in self._starting:
            self._starting.remove(process)
            self._deaths.pop(process, None)

    def now(self, hears_simulator: bool, controllers: int) -> str:
        """Return what is missing and what is done about it; empty if all is there.

        Args:
            hears_simulator: True if states arrive.
            controllers: number of publishers of commands; a killed one is counted for some time.
        """
        remedy = "the cockpit starts it"
        if self._deaths:
            return "; ".join(f"{death}: {remedy}" for death in self._deaths.values())
        if hears_simulator and controllers:
            return ""
        what = "no controller runs" if hears_simulator else "no simulator is heard"
        script = "controller.sh" if hears_simulator else "sim.sh"
        return f"{what}: {remedy if self._ours else f'start ros2_ws/{script}'}"
