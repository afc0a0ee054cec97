"""Whether another controller drives the bicycle, or a recorded one in a bag that is replayed.

A state names the controller whose command led to it. While that is another one, what happens on
the way is not this controller's doing: it sends nothing and claims no goal, but it follows, so
that it can take over as soon as the other one falls silent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from bicycle_common.types import BicycleState, CommandSource
from bicycle_controller.control.goals import Event, Status

TELL_AFTER = 40
"""States in a row that another one drove before it is told: one second at 40 Hz."""


class Standby:
    """Watches who drives.

    Attributes:
        other: the other controller that drove to the newest state; empty where none did.
    """

    def __init__(self, name: str) -> None:
        """Watch for others than `name`."""
        self.other = ""
        self._name = name
        self._row = 0

    def look(self, snapshot: BicycleState) -> bool:
        """Take in a state; whether this controller has come to drive after another one."""
        driven = snapshot.command_source in (CommandSource.FRESH, CommandSource.HELD)
        foreign = driven and snapshot.controller not in ("", self._name)
        before, self.other = self.other, snapshot.controller if foreign else ""
        self._row = self._row + 1 if foreign else 0
        return bool(before) and not foreign

    def keeps_out(self, snapshot: BicycleState, again: bool) -> bool:
        """Whether a state wants no answer.

        Args:
            snapshot: the newest state.
            again: whether it came before. A bicycle that stands still may wait for an answer.
        """
        return bool(self.other) and snapshot.command_source == CommandSource.FRESH and not again

    def warning(self) -> str:
        """One line, once for each time that another one has driven for a while."""
        if self._row != TELL_AFTER:
            return ""
        return (
            f"{self.other} drives this bicycle, so this controller sends nothing: stop one of the "
            "two, or the replay that these states come from"
        )

    def of_own(self, events: Sequence[Event]) -> list[Event]:
        """What is to be told of goals: of those that the other one rides to, that they wait."""
        if not self.other:
            return list(events)
        text = f"waits: {self.other} drives the bicycle"
        return [
            replace(event, status=Status.QUEUED, message=text)
            for event in events
            if event.status in (Status.ACTIVE, Status.QUEUED)
        ]
