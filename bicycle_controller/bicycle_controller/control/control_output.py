"""Output of the control loop for one state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bicycle_common.types import Command
from bicycle_controller.control.goals import Event
from bicycle_controller.control.safety import HandOverReason


@dataclass(frozen=True)
class ControllerSwitch:
    """Change of the active controller, from one state on."""

    episode: int
    step: int
    """Step of the state answered by the new controller."""
    reason: HandOverReason
    """Why the fallback drives; NONE if the policy drives again."""
    stop: bool
    """True if the bicycle is stopped until a new goal comes."""
    policy: str
    """Id of the controller that drives now."""
    count: int
    """Number of switches to the fallback so far."""
    message: str
    """Description for the user, one line."""


class Choice(NamedTuple):
    """Action for one state, and who chose it."""

    action: np.ndarray
    """(3,) N m, m and N, before noise and limits."""
    policy: str
    """Id of the controller that chose it."""
    warning: str = ""
    """A line for the log; empty unless the policy has just begun to fail."""
    switch: ControllerSwitch | None = None
    """Set if the active controller changes with this state."""


@dataclass(frozen=True)
class ControlOutput:
    """Result of one state."""

    command: Command | None
    """Command to send; None without a goal or heading to steer by, or after a fall."""
    events: list[Event]
    """Changes of goals."""
    warning: str = ""
    """A line for the log; empty unless an error has just occurred."""
    hand_over: ControllerSwitch | None = None
    """Set once when the safety layer changes the active controller."""
