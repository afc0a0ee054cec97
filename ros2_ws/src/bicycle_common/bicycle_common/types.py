"""Types shared by the packages: states, commands, starts and pushes.

All values use the paper's signs and symbols; `conventions.py` lists the sign changes in messages.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum

from bicycle_common.validation import require

Point2D = tuple[float, float]
"""(x, y), m."""


FARTHEST_START = 1e5
"""Largest start coordinate (m): beyond it a double no longer resolves a step's motion well."""


FASTEST_START = 20.0
"""Largest start speed (m/s): beyond it one step is half a wheelbase long."""


class CommandSource(IntEnum):
    """Source of a step's input; the numbers are those of CommandEcho."""

    INITIAL = 0
    FRESH = 1
    HELD = 2
    ZERO = 3


@dataclass(frozen=True)
class Command:
    """Input that a controller requests for the step after the state it answers."""

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
    heading_error: float = math.nan
    """rad, positive if the target lies to the right in the state that the command answers (psi_g).
    """
    goal_distance: float = math.nan
    """m from the rear contact of the state answered; NaN without a goal."""
    message: object = field(default=None, compare=False, repr=False)
    """Message that carried the command, to be echoed unchanged; None for a command made here."""

    @property
    def action(self) -> tuple[float, float, float]:
        """Action (T, d, F) in N m, m, N."""
        return self.torque, self.displacement, self.pedal_force


@dataclass(frozen=True)
class AppliedCommand:
    """Input of the step that led to a state."""

    source: CommandSource = CommandSource.INITIAL
    command: Command | None = None
    """None at the start of an episode and for zero input."""

    @property
    def controller(self) -> str:
        """Sender of the command; empty without one."""
        return self.command.controller if self.command else ""

    @property
    def goal(self) -> Point2D | None:
        """Goal that the command pursues, m; None without one."""
        return self.command.goal if self.command else None

    def lateness(self, step: int) -> float:
        """Return how many steps too old the command was that led to `step`; infinite without one.

        The start of an episode counts as punctual.
        """
        if self.source is CommandSource.INITIAL:
            return 0.0
        return math.inf if self.command is None else float(step - 1 - self.command.step)


@dataclass(frozen=True)
class InitialPose:
    """Start of an episode: upright, handlebar straight.

    Raises:
        ValueError: on a value that is not finite or out of range.
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
    """The body of the bicycle after one step, as plain numbers in the paper's signs."""

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
    plant_state: tuple[float, ...] = ()
    """The whole state of the plant in its own order, where the numbers above do not make it up;
    empty for the paper's bicycle."""
    yaw_rate: float = 0.0
    """rad/s, counter-clockwise."""
    pitch: float = 0.0
    """rad, positive with the nose up; zero upright with straight steering."""
    estimated: bool = False
    """True if an estimator computed the state from sensors."""

    @property
    def is_finite(self) -> bool:
        """True if every number that a controller uses is finite."""
        return all(map(math.isfinite, self.plant_state)) and all(
            math.isfinite(value) for value in vars(self).values() if isinstance(value, float)
        )


@dataclass(frozen=True)
class Push:
    """A push that was applied, in the paper's signs."""

    episode: int
    step: int
    """Step of the pushed state."""
    lean_rate: float
    """rad/s added to its lean rate, positive to the left."""
