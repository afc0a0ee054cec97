"""The experiments of section 5 of the paper, as data.

A scenario says where a bicycle starts, where it must go, how fast it rides and what the
controller may do to it. `SCENARIOS` holds the paper's; `replace` makes variants of them.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, field, fields

import numpy as np

from bicycle_common.validation import as_pair, nearest, reject_unknown, require
from bicycle_sim.task.reward import RewardWeights

TEN_KM_H = 10.0 / 3.6
"""m/s, the paper's fixed speed."""


@dataclass(frozen=True)
class Region:
    """A rectangle of the plane to draw points from; a point when both corners are the same."""

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
        """The region of one point, m."""
        return cls((x, y), (x, y))

    def draw(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """`count` points, shape (count, 2), m."""
        return rng.uniform(self.low, self.high, size=(count, 2))


@dataclass(frozen=True)
class Scenario:
    """One task for the bicycle.

    Raises:
        ValueError: on limits that are negative, not finite or contradict each other.
    """

    name: str
    start: Region
    goal: Region
    start_speed: float = TEN_KM_H
    """m/s at the start."""
    heading_spread: float = math.pi
    """rad: the start heading is drawn within this of `heading_centre`; pi is any heading."""
    facing_away: bool = False
    """Whether that spread is about the direction away from the goal, not about +y."""
    torque_limit: float = 2.0
    """N m, largest |T| (row 20)."""
    displacement_limit: float = 0.2
    """m, largest |d| (row 20)."""
    pedal_limit: float = 0.0
    """N, largest |F|; zero keeps the speed fixed."""
    speed_limits: tuple[float, float] | None = None
    """m/s that the speed is kept between (row 18)."""
    max_steps: int = 400
    """Steps after which an episode is cut (truncated, never terminated)."""
    goal_radius: float = 1.0
    """m around the rear contact (row 26)."""
    fall_angle: float = math.pi / 6
    """rad, the lean beyond which a bicycle has fallen (eq. 20)."""
    reward: RewardWeights = field(default_factory=RewardWeights)

    def __post_init__(self) -> None:
        if self.speed_limits is not None:
            object.__setattr__(self, "speed_limits", as_pair(self.speed_limits))
        for name in ("torque_limit", "displacement_limit", "pedal_limit", "heading_spread"):
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

    def to_json(self) -> str:
        """All of it as JSON; floats keep every bit."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Scenario:
        """What `to_json` wrote.

        Raises:
            ValueError: on text that is not such JSON, or on an unknown field.
        """
        return cls.from_dict(json.loads(text))

    @classmethod
    def from_dict(cls, data: dict[str, object]) -> Scenario:
        """A scenario from plain data, as JSON or YAML give it.

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
"""m; the paper gives no field: this one holds its goal (150, 100) and takes its ~1,000 steps."""

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
        # The same with the small displacement of section 5.3.2.
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
    """The scenario of that name.

    Raises:
        ValueError: on an unknown name, with the nearest one.
    """
    if name not in SCENARIOS:
        known = ", ".join(SCENARIOS)
        raise ValueError(f"unknown scenario {name!r}{nearest(name, SCENARIOS)}; known: {known}")
    return SCENARIOS[name]


def scenario_fields() -> list[str]:
    """Names of what `--set NAME=VALUE` may change."""
    return [item.name for item in fields(Scenario)]
