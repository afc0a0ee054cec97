"""What the packages tell each other: states, commands, starts, pushes and transitions.

Everything is in the paper's signs and symbols. `conventions.py` has what messages change.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from bicycle_common.validation import require

Point2D = tuple[float, float]
"""(x, y), m."""


FARTHEST_START = 1e5
"""m: beyond this a double no longer resolves a step's motion well."""


FASTEST_START = 20.0
"""m/s: beyond this one step is half a wheelbase long."""


class CommandSource(IntEnum):
    """Where the input of a step came from; the numbers are those of BicycleState."""

    INITIAL = 0
    FRESH = 1
    HELD = 2
    ZERO = 3


@dataclass(frozen=True)
class Command:
    """What a controller wants done in the step after the state it answers."""

    episode: int
    step: int
    torque: float
    """N m, positive steers left (T)."""
    displacement: float
    """m, positive to the left (d)."""
    pedal_force: float
    """N (F)."""
    goal: Point2D | None = None
    """m, the goal that the command pursues."""
    goal_id: int = 0
    controller: str = ""
    policy: str = ""

    @property
    def action(self) -> tuple[float, float, float]:
        """(T, d, F) in N m, m, N."""
        return self.torque, self.displacement, self.pedal_force


@dataclass(frozen=True)
class InitialPose:
    """Where an episode begins: upright, handlebar straight.

    Raises:
        ValueError: on a value that is not finite or beyond reason.
    """

    x: float
    """m, rear contact (x_b)."""
    y: float
    """m, rear contact (y_b)."""
    heading: float
    """rad (psi)."""
    speed: float
    """m/s (v)."""

    def __post_init__(self) -> None:
        for name in ("x", "y", "heading", "speed"):
            value = getattr(self, name)
            require(math.isfinite(value), f"the start's {name} must be finite, not {value!r}")
        require(
            max(abs(self.x), abs(self.y)) <= FARTHEST_START,
            f"the start ({self.x:g}, {self.y:g}) must lie within {FARTHEST_START:g} m of 0, 0",
        )
        require(
            0 <= self.speed <= FASTEST_START,
            f"the start's speed must be 0 to {FASTEST_START:g} m/s, not {self.speed:g}",
        )


@dataclass(frozen=True)
class BicycleState:
    """The bicycle after one step, as plain numbers in the paper's signs."""

    episode: int
    step: int
    lean_angle: float
    """rad, positive to the left (omega)."""
    lean_rate: float
    """rad/s (omega dot)."""
    lean_acceleration: float
    """rad/s^2 (omega double dot)."""
    steer_angle: float
    """rad, positive to the left (theta)."""
    steer_rate: float
    """rad/s (theta dot)."""
    heading: float
    """rad from +y, counter-clockwise (psi)."""
    front_x: float
    """m (x_f)."""
    front_y: float
    """m (y_f)."""
    rear_x: float
    """m (x_b)."""
    rear_y: float
    """m (y_b)."""
    speed: float
    """m/s (v)."""
    fallen: bool = False
    goal: Point2D | None = None
    """m, the goal that the applied command pursued."""
    heading_error: float = math.nan
    """rad, positive when that goal lies to the right (psi_g); NaN without a goal."""
    goal_distance: float = math.nan
    """m from the rear contact; NaN without a goal."""
    command_source: CommandSource = CommandSource.INITIAL
    command_step: int = -1
    """Step answered by the applied command, -1 for none."""
    controller: str = ""
    """Who sent the applied command; empty for none."""
    action: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0), compare=False)
    """(T, d, F) as commanded, N m, m, N. A state message does not carry it."""


@dataclass(frozen=True)
class Push:
    """A push that acted, in the paper's signs."""

    episode: int
    step: int
    """Of the state that was pushed."""
    lean_rate: float
    """rad/s added to its lean rate, positive to the left."""


@dataclass(frozen=True)
class Transition:
    """One step towards one goal, in the paper's signs; see `task.OBSERVATION_FIELDS`."""

    episode: int
    step: int
    """Of the state that the action was taken in."""
    goal: Point2D
    """m."""
    goal_id: int
    observation: np.ndarray
    """(6,)."""
    action: tuple[float, float, float]
    """(T, d, F) as commanded, N m, m, N."""
    reward: float
    """Equation 20, of the next state."""
    next_observation: np.ndarray
    """(6,)."""
    terminated: bool
    """The goal was reached."""
    truncated: bool
    """The pursuit was cut here: reset, new goal, or no command."""
    fallen: bool
    """The next state is a fallen one."""
    speed: float
    """m/s before the step."""
    policy: str
    """Id of the policy that chose the action."""
