"""Contents of a bicycle's picture, for every renderer."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Scene:
    """Contents of a picture, in the paper's signs."""

    rear: tuple[float, float]
    """m, rear contact."""
    front: tuple[float, float]
    """m, front contact."""
    lean_angle: float
    """rad, positive to the left."""
    steer_angle: float
    """rad, positive to the left."""
    speed: float
    """m/s."""
    goal: tuple[float, float]
    """m."""
    goal_radius: float
    """m."""
    wheel_radius: float
    """m."""
    fallen: bool
