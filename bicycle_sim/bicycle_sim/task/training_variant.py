"""Training variant of a scenario, and its differences from the evaluated one.

What the paper evaluates cannot be learned by stock learners: frozen falls fill their memory, a
step away from the goal costs more than lying, and goals are seldom near. Each difference here is
what the preset `fast` does too; docs/training.md tells what each one buys.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from bicycle_common.geometry import wrap_angle
from bicycle_common.validation import nearest, require
from bicycle_sim.task.scenario import Scenario


@dataclass(frozen=True)
class TrainingVariant:
    """Rewards, falls and starts of training.

    Raises:
        ValueError: on a value out of range.
    """

    cost_cap: float = 4.0
    """Largest cost of one step: riding away from the goal costs no more than lying."""
    reward_scale: float = 0.05
    """Factor on every reward, so that a fall is worth -20 at most."""
    near_share: float = 0.5
    """Share of goals drawn near the bicycle, at any bearing."""
    near_distance: tuple[float, float] = (1.2, 15.0)
    """Least and largest distance of those goals, m."""
    tilt: float = 0.1
    """Half width of the uniform start lean, rad."""
    tilt_rate: float = 0.2
    """Half width of the start lean rate, rad/s."""
    steer: float = 0.2
    """Half width of the start steering angle, rad."""
    steer_rate: float = 0.4
    """Half width of the start steering rate, rad/s."""
    any_speed: bool = True
    """True to draw the start speed between the scenario's limits, if it has some."""
    max_steps: int = 600
    """Largest step limit of an episode."""

    def __post_init__(self) -> None:
        for name in ("cost_cap", "reward_scale"):
            value = getattr(self, name)
            require(value > 0 and math.isfinite(value), f"{name} must be above zero, not {value}")
        require(0 <= self.near_share <= 1, f"near_share must lie in 0..1, not {self.near_share}")
        low, high = self.near_distance
        require(0 < low <= high, f"near_distance must grow from above zero, not {low, high}")
        for name in ("tilt", "tilt_rate", "steer", "steer_rate"):
            value = getattr(self, name)
            require(0 <= value < math.inf, f"{name} must be zero or more, not {value!r}")
        require(self.max_steps >= 1, f"max_steps must be at least 1, not {self.max_steps!r}")

    def scenario(self, scenario: Scenario) -> Scenario:
        """Return the scenario with the step limit of training."""
        return replace(scenario, max_steps=min(scenario.max_steps, self.max_steps))

    def start_speed(self, scenario: Scenario, rng: np.random.Generator) -> float:
        """Draw a start speed, m/s."""
        if not self.any_speed or scenario.speed_limits is None:
            return scenario.start_speed
        return rng.uniform(*scenario.speed_limits)

    def tilts(self, rng: np.random.Generator) -> np.ndarray:
        """Draw lean, lean rate, steering and steering rate, (4,) rad and rad/s."""
        spread = np.array([self.tilt, self.tilt_rate, self.steer, self.steer_rate])
        return rng.uniform(-spread, spread)

    def goal(self, start: np.ndarray, goal: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return `goal` (2,), or by chance one near `start` (2,); m."""
        near, bearing = rng.random() < self.near_share, rng.uniform(-math.pi, math.pi)
        distance, bearing = rng.uniform(*self.near_distance), wrap_angle(bearing)
        if not near:
            return goal
        return start + distance * np.array([-math.sin(bearing), math.cos(bearing)])


VARIANTS: dict[str, TrainingVariant | None] = {"evaluation": None, "training": TrainingVariant()}
"""Variants by name; `evaluation` is the scenario as it is."""


def variant_named(name: str) -> TrainingVariant | None:
    """Return the variant of that name.

    Raises:
        ValueError: on an unknown name; names the nearest one.
    """
    if name not in VARIANTS:
        known = " or ".join(VARIANTS)
        raise ValueError(f"unknown variant {name!r}{nearest(name, VARIANTS)}; choose {known}")
    return VARIANTS[name]
