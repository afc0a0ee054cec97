"""Standby: detect that another controller drives, or a recorded one in a replayed bag.

An echo names the controller whose command led to a state. While that is another one, this
controller is not responsible for the ride: it sends nothing and claims no goal, but it follows the
states, so that it can take over as soon as the other one falls silent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from bicycle_common.types import AppliedCommand, CommandSource
from bicycle_controller.control.goals import Event, Status

TELL_AFTER = 40
"""States in a row under another controller before it is reported: one second at 40 Hz."""


class Standby:
    """Detects another active controller.

    Attributes:
        other: the controller that drove to the newest state, if another; else empty.
    """

    def __init__(self, name: str) -> None:
        """Ignore the controller `name`, which is this one."""
        self.other = ""
        self._name = name
        self._row = 0

    def look(self, applied: AppliedCommand | None) -> bool:
        """Process the command that led to a state, None if it is not known.

        Returns:
            True if this controller has just resumed driving.
        """
        if applied is None:
            return False
        foreign = applied.controller not in ("", self._name)
        before, self.other = self.other, applied.controller if foreign else ""
        self._row = self._row + 1 if foreign else 0
        return bool(before) and not foreign

    def keeps_out(self, applied: AppliedCommand | None, again: bool) -> bool:
        """Return True if a state must not be answered.

        Args:
            applied: the command that led to it; None if that is not known.
            again: True if it is a repetition. A bicycle at rest may wait for an answer.
        """
        fresh = applied is None or applied.source is CommandSource.FRESH
        return bool(self.other) and fresh and not again

    def warning(self) -> str:
        """Return one line, once for each time that another controller has driven for some time."""
        if self._row != TELL_AFTER:
            return ""
        return (
            f"{self.other} drives this bicycle, so this controller sends nothing: stop one of the "
            "two, or the replay that these states come from"
        )

    def of_own(self, events: Sequence[Event]) -> list[Event]:
        """Return the events to report: goals that the other controller pursues are waiting."""
        if not self.other:
            return list(events)
        text = f"waits: {self.other} drives the bicycle"
        return [
            replace(event, status=Status.QUEUED, message=text)
            for event in events
            if event.status in (Status.ACTIVE, Status.QUEUED)
        ]
