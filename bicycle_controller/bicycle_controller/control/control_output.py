"""What the controller says to one state."""

from __future__ import annotations

from dataclasses import dataclass

from bicycle_common.types import Command
from bicycle_controller.control.goals import Event
from bicycle_controller.control.safety import Reason


@dataclass(frozen=True)
class ControllerSwitch:
    """Who drives from one state on."""

    episode: int
    step: int
    """Of the state that is answered so."""
    reason: Reason
    """Why the fallback drives; NONE when the policy drives again."""
    stop: bool
    """Whether the bicycle is stopped, until a new goal comes."""
    policy: str
    """Id of what drives."""
    count: int
    """Times that the fallback took over so far."""
    message: str
    """One line."""


@dataclass(frozen=True)
class ControlOutput:
    """What follows from one state."""

    command: Command | None
    """None where there is nothing to steer by, or the bicycle lies."""
    events: list[Event]
    """What has become of goals."""
    warning: str = ""
    """One line for the log; empty unless something has just gone wrong."""
    hand_over: ControllerSwitch | None = None
    """Told once when the safety layer changes who drives."""
