"""Experiments of section 5 of the paper, as data.

A scenario defines where a bicycle starts, where it must go, how fast it rides and the limits of
its controller. `SCENARIOS` holds the paper's; `replace` makes variants of them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

import numpy as np

from bicycle_common import json_input
from bicycle_common.observation import ACTION_FIELDS
from bicycle_common.validation import as_pair, nearest, reject_unknown, require
from bicycle_sim.plants.base import FALL_ANGLE
from bicycle_sim.task.reward import RewardWeights

TEN_KM_H = 10.0 / 3.6
"""m/s, the paper's fixed speed."""


@dataclass(frozen=True)
class Region:
    """Rectangle of the plane to draw points from; a point if both corners are equal."""

    low: tuple[float, float]
    """m, (x, y) of one corner."""
    high: tuple[float, float]
    """m, (x, y) of the opposite corner."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "low", as_pair(self.low))
        object.__setattr__(self, "high", as_pair(self.high))
        require(
            self.low[0] <= self.high[0] and self.low[1] <= self.high[1],
            f"region's low corner {self.low} lies beyond its high corner {self.high}",
        )

    @classmethod
    def point(cls, x: float, y: float) -> Region:
        """Return the region of one point, m."""
        return cls((x, y), (x, y))

    def draw(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Draw `count` points, shape (count, 2), m."""
        return rng.uniform(self.low, self.high, size=(count, 2))


@dataclass(frozen=True)
class Scenario:
    """One task for the bicycle.

    Raises:
        ValueError: on limits that are negative, not finite or contradictory.
    """

    name: str
    start: Region
    goal: Region
    start_speed: float = TEN_KM_H
    """Speed at the start, m/s."""
    heading_spread: float = math.pi
    """Largest difference of the start heading from `heading_centre`, rad; pi allows any."""
    facing_away: bool = False
    """True to centre that spread on the direction away from the goal instead of +y."""
    torque_limit: float = 2.0
    """N m, largest |T| (row 20)."""
    displacement_limit: float = 0.2
    """m, largest |d| (row 20)."""
    pedal_limit: float = 0.0
    """N, largest |F|; zero keeps the speed fixed."""
    speed_limits: tuple[float, float] | None = None
    """Bounds of the speed, m/s (row 18)."""
    max_steps: int = 400
    """Steps after which an episode is truncated, never terminated."""
    goal_radius: float = 1.0
    """Radius around the goal within which the rear contact has reached it, m (row 26)."""
    silence_gain: float = 0.0
    """N m per rad/s and m/s: without a command the handlebar steers into the lean, see
    `bicycle_common.steer_into_lean`; zero leaves it without torque."""
    fall_angle: float = FALL_ANGLE
    """Lean beyond which a bicycle has fallen, rad (eq. 20)."""
    reward: RewardWeights = field(default_factory=RewardWeights)

    def __post_init__(self) -> None:
        if self.speed_limits is not None:
            object.__setattr__(self, "speed_limits", as_pair(self.speed_limits))
        for name in (
            "torque_limit",
            "displacement_limit",
            "pedal_limit",
            "heading_spread",
            "silence_gain",
        ):
            value = getattr(self, name)
            require(
                math.isfinite(value) and value >= 0,
                f"{name} must be zero or more and finite, not {value!r}",
            )
        for name in ("start_speed", "goal_radius", "fall_angle"):
            value = getattr(self, name)
            require(
                math.isfinite(value) and value > 0,
                f"{name} must be above zero and finite, not {value!r}",
            )
        require(
            isinstance(self.max_steps, int) and self.max_steps >= 1,
            f"max_steps must be at least 1 and a whole number, not {self.max_steps!r}",
        )
        if self.speed_limits is not None:
            low, high = self.speed_limits
            require(
                0 < low <= self.start_speed <= high < math.inf,
                f"start_speed {self.start_speed} m/s must lie within speed_limits {low}..{high}",
            )

    @property
    def action_limits(self) -> np.ndarray:
        """Largest |T| (N m), |d| (m) and |F| (N), shape (3,)."""
        return np.array([self.torque_limit, self.displacement_limit, self.pedal_limit])

    def suited(self, input_names: Sequence[str]) -> Scenario:
        """Return the scenario without the actions that a plant has no use for.

        Args:
            input_names: those it has, see `Plant.input_names`.
        """
        limits = {name: f"{name.removesuffix('_force')}_limit" for name in ACTION_FIELDS}
        missing = [limits[name] for name in ACTION_FIELDS if name not in input_names]
        zero: dict[str, Any] = {name: 0.0 for name in missing if getattr(self, name) != 0.0}
        return replace(self, **zero) if zero else self

    def with_motor(self, torque_limit: float | None) -> Scenario:
        """Return the scenario with the torque of the bicycle's own motor.

        Args:
            torque_limit: N m, see `Plant.torque_limit`; None leaves the scenario's.
        """
        return self if torque_limit is None else replace(self, torque_limit=torque_limit)

    def to_json(self) -> str:
        """Return everything as JSON; floats keep every bit."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Scenario:
        """Return the scenario that `to_json` wrote.

        Raises:
            ValueError: on other text, or on an unknown field.
        """
        return cls.from_dict(json_input.parse(text))

    @classmethod
    def from_dict(cls, data: dict[str, object]) -> Scenario:
        """Return a scenario from plain data, as JSON or YAML give it.

        Raises:
            ValueError: on an unknown field.
        """
        reject_unknown(cls, data)
        values = dict(data)
        for name, kind in (("start", Region), ("goal", Region), ("reward", RewardWeights)):
            inner = values.get(name)
            if name in values and not isinstance(inner, kind):
                reject_unknown(kind, inner)
                values[name] = kind(**inner)  # type: ignore[arg-type]
        return cls(**values)  # type: ignore[arg-type]


FIELD = Region((0.0, 0.0), (200.0, 200.0))
"""Field, m; the paper gives none: this one holds its goal (150, 100), ~1,000 steps away."""

_FIXED_START = Region.point(50.0, 50.0)
_FIXED_GOAL = Region.point(60.0, 65.0)

SCENARIOS: dict[str, Scenario] = {
    scenario.name: scenario
    for scenario in (
        # Figures 10-12.
        Scenario("fixed-start-fixed-goal", start=_FIXED_START, goal=_FIXED_GOAL),
        # Figure 13.
        Scenario(
            "random-start-fixed-goal",
            start=FIELD,
            goal=Region.point(150.0, 100.0),
            max_steps=4000,
        ),
        # Figure 14.
        Scenario("random-start-random-goal", start=FIELD, goal=FIELD, max_steps=4000),
        # Same, with the small displacement of section 5.3.2.
        Scenario(
            "random-small-displacement",
            start=FIELD,
            goal=FIELD,
            displacement_limit=0.02,
            max_steps=4000,
        ),
        # Figure 15 with and without the pedal.
        Scenario(
            "learning-to-turn",
            start=_FIXED_START,
            goal=_FIXED_GOAL,
            start_speed=2.5,
            heading_spread=math.pi / 6,
            facing_away=True,
            displacement_limit=0.02,
            pedal_limit=100.0,
            speed_limits=(1.0, 5.0),
            max_steps=500,
        ),
        Scenario(
            "learning-to-turn-fixed-speed",
            start=_FIXED_START,
            goal=_FIXED_GOAL,
            start_speed=2.5,
            heading_spread=math.pi / 6,
            facing_away=True,
            displacement_limit=0.02,
            max_steps=500,
        ),
        # Figure 16.
        Scenario(
            "learned-speed",
            start=FIELD,
            goal=FIELD,
            start_speed=2.0,
            displacement_limit=0.02,
            pedal_limit=100.0,
            speed_limits=(1.0, 5.0),
            max_steps=4000,
        ),
    )
}


def named(name: str) -> Scenario:
    """Return the scenario of that name.

    Raises:
        ValueError: on an unknown name; names the nearest one.
    """
    if name not in SCENARIOS:
        known = ", ".join(SCENARIOS)
        raise ValueError(f"unknown scenario {name!r}{nearest(name, SCENARIOS)}; known: {known}")
    return SCENARIOS[name]


def scenario_fields() -> list[str]:
    """Return the names that `--set NAME=VALUE` accepts."""
    return [item.name for item in fields(Scenario)]
