"""Configuration of imitation: one actor learns to ride any bicycle from each bicycle's own LQR."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

from bicycle_common.validation import (
    as_pair,
    require,
    require_between,
    require_choice,
    require_positive,
)
from bicycle_sim.plants.whipple.random_bicycles import Ranges

SCALES = {
    "steer_angle": 0.5,
    "steer_rate": 3.0,
    "lean_angle": 0.3,
    "lean_rate": 1.0,
    "lean_acceleration": 5.0,
    "heading_error": 2.0,
    "speed": 4.0,
    "torque": 7.0,
}
"""Natural ranges of the inputs."""


@dataclass(frozen=True)
class TeacherWeights:
    """Weights of a linear regulator that teaches.

    Raises:
        ValueError: on a weight that is not above zero.
    """

    lean: float
    """Cost of a squared rad."""
    lean_rate: float
    """Cost of a squared rad/s."""
    steer: float
    """Cost of a squared rad."""
    steer_rate: float
    """Cost of a squared rad/s."""
    torque: float
    """Cost of a squared N m."""

    def __post_init__(self) -> None:
        for item in fields(self):
            require_positive(f"teacher weight {item.name}", getattr(self, item.name))


@dataclass(frozen=True)
class CalmConfig:
    """A second regulator of each bicycle, which rides while nothing pushes it.

    Weights that catch the largest kicks steer far for a lean that is only noise, and fall in turns
    under a long delay; weights that cost steering ride calmly and catch less. The disturbance that
    says who rides is the lean rate plus `pull` times the lean beside the wanted one, as a share of
    the largest kick that the other regulator catches.

    Raises:
        ValueError: on a value out of range.
    """

    weights: TeacherWeights
    begin: float = 0.4
    """Share up to which the calm regulator rides alone."""
    end: float = 0.8
    """Share from which on the other one rides alone; between them their torques are blended."""
    pull: float = 3.0
    """1/s, about the rate at which a bicycle falls over."""

    def __post_init__(self) -> None:
        require_between("imitation.calm.begin", self.begin, 0.0, math.inf)
        require(self.end > self.begin, "imitation.calm.end must be above imitation.calm.begin")
        require_between("imitation.calm.pull", self.pull, 0.0, math.inf)


@dataclass(frozen=True)
class TurnConfig:
    """The turns that teachers want for a heading error.

    Raises:
        ValueError: on a value that is not above zero; the damping may be zero.
    """

    heading_time: float = 2.0
    """s in which a wanted turn would undo a small heading error."""
    tilt_limit: float = 0.35
    """rad, the steepest wanted lean."""
    steer_limit: float = 0.6
    """rad, the largest wanted steering."""
    hold_share: float = 0.5
    """Share of the torque limit that may be needed to hold a turn."""
    damping: float = 0.0
    """Share of what the steering lacks of the wanted one that is wanted besides: a heading that
    turns too fast, as after a kick, is held back before its error has grown."""

    def __post_init__(self) -> None:
        for item in fields(self):
            if item.name != "damping":
                require_positive(f"imitation.turns.{item.name}", getattr(self, item.name))
        require_between("imitation.turns.damping", self.damping, 0.0, math.inf)


@dataclass(frozen=True)
class RidingConfig:
    """Settings of the training rides.

    Raises:
        ValueError: on a value out of range.
    """

    speeds: tuple[float, float] = (0.9, 6.6)
    """m/s at which rides begin."""
    seconds: float = 12.0
    """s, mean duration of a ride that does not end in a fall."""
    kick_every: float = 2.0
    """s, mean time between two kicks."""
    kick_share: float = 1.15
    """Largest kick, as a share of what the teacher catches on that bicycle at that speed."""
    turn_every: float = 5.0
    """s, mean time between two changes of the wanted heading or of its rate."""
    gust: float = 15.0
    """N, standard deviation of the gusts at the most exposed bicycle."""
    noise: float = 1.0
    """Largest share of the sensor noise below; each bicycle has a share of its own."""
    lean_noise: tuple[float, float] = (0.005, 0.009)
    """rad, white noise and largest bias of the lean angle."""
    rate_noise: tuple[float, float] = (0.01, 0.02)
    """rad/s, the same of the gyro."""
    steer_noise: tuple[float, float] = (0.001, 0.009)
    """rad, the same of the steering angle."""
    steer_rate_noise: float = 0.05
    """rad/s, white noise of the steering rate."""

    def __post_init__(self) -> None:
        for name in ("speeds", "lean_noise", "rate_noise", "steer_noise"):
            object.__setattr__(self, name, as_pair(getattr(self, name)))
        low, high = self.speeds
        require(0 < low < high, f"imitation.riding.speeds must grow, not be {low, high}")
        for name in ("seconds", "kick_every", "turn_every"):
            require_positive(f"imitation.riding.{name}", getattr(self, name))
        for name in ("kick_share", "gust", "noise", "steer_rate_noise"):
            require_between(f"imitation.riding.{name}", getattr(self, name), 0.0, math.inf)


@dataclass(frozen=True)
class ImitationConfig:
    """Settings of imitation while the actor rides (DAgger).

    Raises:
        ValueError: on a value out of range.
    """

    now: tuple[str, ...]
    """Inputs of the present, see `policy.inputs`."""
    before: tuple[str, ...]
    """Inputs that it also sees of each of the last `periods`."""
    periods: int
    """Control periods that it remembers."""
    hidden: tuple[int, ...]
    """Widths of the hidden layers of one of its two mirrored halves."""
    torque_limit: float
    """N m, the actor's largest torque; the bicycle's own limit cuts it."""
    teachers: tuple[TeacherWeights, ...]
    """Weights of which each bicycle has the best at each speed."""
    judged_in_turns: bool = False
    """True to judge the weights by kicks into a turn, the hardest; False by kicks straight on. In
    turns, others than the first set of weights have to be better by a twentieth."""
    calm: CalmConfig | None = None
    """Regulators that ride while nothing pushes; None if those of `teachers` do it all."""
    turns: TurnConfig = field(default_factory=TurnConfig)
    riding: RidingConfig = field(default_factory=RidingConfig)
    ranges: Ranges = field(default_factory=Ranges)
    """Ranges of the random bicycles' parameters."""
    rounds: int = 3
    """Times that all bicycles are drawn anew, over the run."""
    teacher_share: float = 0.1
    """Share of the rides that the teachers ride; in the first round they begin with all."""
    substeps: int = 3
    """Steps of integration in a control period."""
    rows: int = 600_000
    """States that are remembered, with the teachers' answers."""
    batch: int = 2048
    """States per update."""
    rate: float = 0.001
    """Learning rate of Adam at the beginning; it falls to a hundredth along a cosine."""
    fine: float = 0.5
    """Error (N m) up to which errors count in full; of larger errors the logarithm counts, so that
    calm rides weigh as much as those after a kick."""
    average: float = 0.995
    """Share of the averaged weights that an update keeps."""

    def __post_init__(self) -> None:
        for name in ("periods", "rounds", "substeps", "rows", "batch"):
            require(getattr(self, name) >= 1, f"imitation.{name} must be at least 1")
        for name in ("torque_limit", "rate", "fine"):
            require_positive(f"imitation.{name}", getattr(self, name))
        require_between("imitation.teacher_share", self.teacher_share, 0.0, 1.0)
        require_between("imitation.average", self.average, 0.0, 1.0)
        for name in ("now", "before"):
            words = getattr(self, name)
            for word in words:
                require_choice(f"imitation.{name}", word, tuple(SCALES))
            require(len(set(words)) == len(words), f"imitation.{name} names an input twice")
        require("torque" not in self.now, "imitation.now: the torque is what the actor chooses")
        require(bool(self.hidden), "imitation.hidden needs a layer")
        require(bool(self.teachers), "imitation.teachers needs a set of weights")
        require(self.batch <= self.rows, "imitation.batch must be at most imitation.rows")
