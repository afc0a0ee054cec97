"""Configuration of a training run: one frozen dataclass per concern, validated on creation.

The algorithms' parts are in `algorithms.py`. Values of the paper have no default: they stand
only in `presets/`. Everything beyond the paper is a switch that is off by default.
`loading.py` reads these classes from YAML and from the command line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from bicycle_common.validation import (
    as_pair,
    require,
    require_between,
    require_choice,
    require_positive,
)
from bicycle_controller.config.algorithms import DdpgConfig, LearnerConfig, NafConfig, PpoConfig
from bicycle_controller.config.imitation import ImitationConfig
from bicycle_controller.control.exploration_noise import NoiseConfig
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant
from bicycle_sim.task.scenario import SCENARIOS, Scenario

__all__ = [
    "DdpgConfig",
    "EvaluationConfig",
    "NafConfig",
    "NoiseConfig",
    "PpoConfig",
    "RecordConfig",
    "RunConfig",
    "ShapingConfig",
    "StartsConfig",
    "TeacherConfig",
]

ALGORITHMS = ("ddpg", "naf", "ppo", "imitation")
"""Fields of `RunConfig` of which a run has exactly one."""


@dataclass(frozen=True)
class StartsConfig:
    """Differences between training starts and the scenario's, which evaluation always uses.

    The six observations contain no distance, so a policy learns to pass close to a goal at any
    bearing only if it sees such goals often.

    Raises:
        ValueError: on a value out of range.
    """

    near_share: float = 0.0
    """Share of goals drawn near the bicycle at any bearing, instead of by the scenario."""
    near_distance: tuple[float, float] = (1.5, 15.0)
    """Least and largest distance of those goals, m."""
    tilt: float = 0.0
    """Half width of the uniform start lean, rad."""
    tilt_rate: float = 0.0
    """Half width of the start lean rate, rad/s."""
    steer: float = 0.0
    """Half width of the start steering angle, rad."""
    steer_rate: float = 0.0
    """Half width of the start steering rate, rad/s."""
    any_speed: bool = False
    """True to draw the start speed between the scenario's limits, if it has some."""
    ride_on: float = 0.0
    """Share of reached goals and time-outs after which the bicycle continues from its position to
    a new goal, instead of starting again."""
    max_steps: int = 0
    """Step limit of a training episode; 0 keeps the scenario's."""
    speeds: tuple[float, float] | None = None
    """Least and largest start speed, m/s, near which more are drawn than between them; the
    scenario's if None. A bicycle without a pedal keeps it."""
    delay: int = 0
    """Largest number of steps by which actions arrive late; each episode has its own."""
    kick: float = 0.0
    """Half width of the jumps of the lean rate during a ride, rad/s."""
    kick_every: float = 4.0
    """Mean time between two such jumps, s."""
    noise: float = 0.0
    """Largest standard deviation of noise on each observation, in its unit; each episode has its
    own."""
    one_hardship: bool = False
    """True if an episode has only one of `speeds`, `delay`, `kick` and `noise`, or none, each as
    often; False if it has all of them."""

    def __post_init__(self) -> None:
        if self.speeds is not None:
            slowest, fastest = as_pair(self.speeds)
            object.__setattr__(self, "speeds", (slowest, fastest))
            require(
                0 < slowest <= fastest < math.inf,
                f"starts.speeds must grow from above zero, not {slowest, fastest}",
            )
        require_between("starts.delay", self.delay, 0, 40)
        for name in ("kick", "noise"):
            require_between(f"starts.{name}", getattr(self, name), 0.0, math.inf)
        require_positive("starts.kick_every", self.kick_every)
        for name in ("near_share", "ride_on"):
            require_between(f"starts.{name}", getattr(self, name), 0.0, 1.0)
        for name in ("tilt", "tilt_rate", "steer", "steer_rate", "max_steps"):
            require_between(f"starts.{name}", getattr(self, name), 0.0, math.inf)
        low, high = self.near_distance
        require(
            0 < low <= high, f"starts.near_distance must grow from above zero, not {low, high}"
        )


@dataclass(frozen=True)
class ShapingConfig:
    """Changes of the training reward against equation 20; evaluation always uses the equation.

    Raises:
        ValueError: on a value out of range.
    """

    heading_share: float = 1.0
    """Share of equation 20's heading term that is kept."""
    progress: float = 0.0
    """Cost of a step without progress to the goal: progress times
    (1 - v cos(heading_error) / v_top), with the scenario's top speed v_top. Its sum over a ride is
    proportional to the excess over the time of a straight ride at top speed."""

    def __post_init__(self) -> None:
        require_between("shaping.heading_share", self.heading_share, 0.0, 1.0)
        require_between("shaping.progress", self.progress, 0.0, math.inf)


@dataclass(frozen=True)
class TeacherConfig:
    """Controller that rides some of the training bicycles, with the same exploration noise.

    An off-policy learner can learn from any rides; these show it early the value of a goal.

    Raises:
        ValueError: on a value out of range, or a share without a controller.
    """

    controller: str = ""
    """`lqr`, or another name or file that `bicycle evaluate` accepts; empty for none."""
    share: float = 0.0
    """Share of the bicycles ridden by it."""

    def __post_init__(self) -> None:
        require_between("teacher.share", self.share, 0.0, 1.0)
        require(
            bool(self.controller) == (self.share > 0),
            "a teacher needs both teacher.controller and teacher.share, or neither",
        )


@dataclass(frozen=True)
class EvaluationConfig:
    """Evaluation of a policy during training: without noise, from fixed seeds, in one call.

    Raises:
        ValueError: on a value out of range.
    """

    every: int = 5_000
    """Updates between two evaluations."""
    episodes: int = 256
    """Starts per evaluation."""
    near_episodes: int = 0
    """Extra starts with a goal within `near_distance`, where orbits occur; they count by half."""
    near_distance: float = 12.0
    """Half width of the square about the bicycle from which those goals are drawn, m."""
    shake: float = 0.0
    """Sigma of exploration noise under which another 128 bicycles ride for half a minute; the
    share that falls counts against the policy. 0 disables this."""
    hard_episodes: int = 0
    """Rides to near goals under each hardship that `starts` names alone: its longest delay, its
    kick, its noise, its lowest and highest speed, and on `physics_too`; those that do not reach
    their goal count against the policy. 0 disables this."""
    seed: int = 1_000_003
    """Seed of those starts, the same every time."""
    max_steps: int = 0
    """Step limit of its episodes; 0 keeps the scenario's."""
    stop_at: float = 0.0
    """Reach rate that ends the run; 0 disables this."""
    stop_falls: float = 1.0
    """Largest fall rate at which `stop_at` ends the run."""
    keep: int = 0
    """Number of evaluated policies, spread over the run, that stay in its folder `policies`;
    imitation has none of them."""

    def __post_init__(self) -> None:
        for name in ("every", "episodes"):
            value = getattr(self, name)
            require(value >= 1, f"evaluation.{name} must be at least 1, not {value!r}")
        for name in ("max_steps", "near_episodes", "shake", "hard_episodes", "keep"):
            require_between(f"evaluation.{name}", getattr(self, name), 0, math.inf)
        require_positive("evaluation.near_distance", self.near_distance)
        for name in ("stop_at", "stop_falls"):
            require_between(f"evaluation.{name}", getattr(self, name), 0.0, 1.0)


@dataclass(frozen=True)
class RecordConfig:
    """Records of the training episodes, see `episode_log`.

    Raises:
        ValueError: on a value out of range.
    """

    episodes: bool = False
    """True to write the result of every episode."""
    tracks_every: int = 0
    """Interval of episodes whose track is written too; 0 writes none."""
    track_step: int = 8
    """Steps between two points of a track."""

    def __post_init__(self) -> None:
        require_between("record.tracks_every", self.tracks_every, 0, math.inf)
        require_positive("record.track_step", self.track_step)


@dataclass(frozen=True)
class RunConfig:
    """Complete training run of one algorithm.

    Raises:
        ValueError: on a value out of range, on zero or several algorithms, or on a value that the
            algorithm does not use.
    """

    noise: NoiseConfig
    steps: int
    """Environment steps, summed over all bicycles."""
    ddpg: DdpgConfig | None = None
    naf: NafConfig | None = None
    ppo: PpoConfig | None = None
    imitation: ImitationConfig | None = None
    bicycles: int = 1
    """Bicycles stepped at once."""
    warm_up: int = 1_000
    """First environment steps, with uniformly drawn actions (errata row 36)."""
    updates: int = 1
    """Updates after a step of all bicycles."""
    update_every: int = 1
    """Steps of all bicycles between two rounds of updates."""
    offline_updates: int = 20_000
    """Updates that `bicycle learn` makes from recorded rides, which have no steps."""
    seed: int = 1
    scenario: Scenario = SCENARIOS["random-start-random-goal"]
    physics: Plant[Any] = field(default_factory=registry.default)
    """The bicycle: a mode of the paper's, or a mapping that may name plant and bicycle."""
    physics_too: Plant[Any] | None = None
    """Another bicycle of the same kind, which every second one is in training; rides are scored on
    `physics` alone."""
    starts: StartsConfig = field(default_factory=StartsConfig)
    shaping: ShapingConfig = field(default_factory=ShapingConfig)
    teacher: TeacherConfig = field(default_factory=TeacherConfig)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)
    record: RecordConfig = field(default_factory=RecordConfig)
    device: str = "cpu"
    """`cpu` or `cuda`."""
    threads: int = 1
    """Threads of torch; at these sizes more than one does not help."""
    tensorboard: bool = True
    """True to write TensorBoard files too, if it is installed."""
    log_every: int = 1_000
    """Updates between two lines of the log."""
    save_every: float = 30.0
    """Time between two checkpoints, s; `kill -9` loses at most this much."""
    preset: str = ""
    """Name of the preset on which this is based."""

    def __post_init__(self) -> None:
        whole = ("steps", "bicycles", "updates", "update_every", "offline_updates")
        for name in (*whole, "threads", "log_every"):
            value = getattr(self, name)
            require(value >= 1, f"{name} must be at least 1, not {value!r}")
        for name in ("warm_up", "save_every", "seed"):
            require_between(name, getattr(self, name), 0.0, math.inf)
        require_choice("device", self.device, ("cpu", "cuda"))
        given = [name for name in ALGORITHMS if getattr(self, name) is not None]
        require(
            len(given) == 1,
            f"a run has exactly one of {', '.join(ALGORITHMS)}, not"
            f" {' and '.join(given) or 'none'}: extend a preset, and set the other to null",
        )
        if self.ppo is not None:
            self._check_on_policy(self.ppo)
        mirrors = self.ddpg is not None and (self.ddpg.mirror or self.ddpg.symmetric_actor)
        _, displacement, pedal = self.scenario.action_limits
        require(
            not mirrors or displacement > 0 or pedal == 0,
            "ddpg.mirror and ddpg.symmetric_actor take the second action for the displacement:"
            " with a pedal they need a scenario.displacement_limit above zero",
        )
        imitates_teacher = self.ddpg is not None and self.ddpg.bc_to == "teacher"
        require(
            not imitates_teacher or self.teacher.share > 0,
            "ddpg.bc_to=teacher needs a teacher: set teacher.controller and teacher.share",
        )

    def _check_on_policy(self, ppo: PpoConfig) -> None:
        """Refuse what PPO does not use: it explores by its policy, updates after each rollout."""
        foreign = {"warm_up": (self.warm_up, 0), "noise.kind": (self.noise.kind, "none")}
        foreign |= {"teacher.share": (self.teacher.share, 0)}
        foreign |= {"updates": (self.updates, 1), "update_every": (self.update_every, 1)}
        for name, (value, only) in foreign.items():
            require(value == only, f"{name} must be {only} for ppo, not {value!r}")
        rows = ppo.rollout * self.bicycles
        require(
            ppo.batch <= rows,
            f"ppo.batch must be at most {rows}, ppo.rollout x bicycles, not {ppo.batch}",
        )

    @property
    def algorithm(self) -> str:
        """Name of this run's algorithm, one of `ALGORITHMS`."""
        return next(name for name in ALGORITHMS if getattr(self, name) is not None)

    @property
    def learner(self) -> LearnerConfig:
        """Configuration of this run's algorithm.

        Raises:
            ValueError: for imitation, which has no such learner.
        """
        require(self.imitation is None, "imitation is for 'bicycle train' alone")
        found: LearnerConfig = getattr(self, self.algorithm)
        return found

    @property
    def rounds_between(self) -> int:
        """Steps of all bicycles between two rounds of updates."""
        return self.update_every if self.ppo is None else self.ppo.rollout

    @property
    def updates_due(self) -> int:
        """Updates of one such round; for PPO, minibatches of all its epochs."""
        if self.ppo is None:
            return self.updates
        return self.ppo.epochs * math.ceil(self.ppo.rollout * self.bicycles / self.ppo.batch)
