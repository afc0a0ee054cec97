"""What a training run is made of: one frozen dataclass per concern, validated on creation.

The values of the paper's Tables 2 and 3 have no default here: their one home is
`presets/paper.yaml`. Everything that goes beyond the paper is a switch that is off by default.
`settings.py` reads these classes from YAML and from the command line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from bicycle_sim.config import require
from bicycle_sim.parameters import Physics
from bicycle_sim.scenario import SCENARIOS, Scenario

NATURAL_SCALE = (0.8, 3.0, 0.3, 1.0, 5.0, 2.0)
"""Natural ranges of the six observations, in the order of `task.OBSERVATION_FIELDS`."""


def _require_between(name: str, value: float, low: float, high: float) -> None:
    require(low <= value <= high, f"{name} must lie within {low} and {high}, not {value!r}")


def _require_positive(name: str, value: float) -> None:
    require(math.isfinite(value) and value > 0, f"{name} must be above zero, not {value!r}")


def _require_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    require(value in choices, f"{name} must be one of {', '.join(choices)}, not {value!r}")


@dataclass(frozen=True)
class DdpgConfig:
    """Deep deterministic policy gradient (section 4 of the paper) and what may be added to it.

    Raises:
        ValueError: on a value out of range or a switch that contradicts another.
    """

    actor_hidden: tuple[int, ...]
    """Units of the actor's hidden layers (Table 2)."""
    critic_hidden: tuple[int, ...]
    """Units of the critic's hidden layers (Table 2, errata row 28)."""
    actor_learning_rate: float
    """Adam's step for the actor (Table 2, errata row 29)."""
    critic_learning_rate: float
    """Adam's step for the critic (Table 2, errata row 29)."""
    initialisation: str
    """`literal`: every parameter within 3e-3 (Table 2 as printed); `output`: Xavier, and only
    the output layer within 3e-3 (errata row 30); `fan_in`: Lillicrap et al. 2016."""
    tau: float
    """Share of the main network that enters its target at each update (section 4.1)."""
    gamma: float
    """Discount per step (Table 3)."""
    batch: int
    """Transitions per update (Table 3)."""
    capacity: int
    """Transitions that the replay memory holds (Table 3)."""
    fall: str
    """`frozen`: the fallen bicycle's steps enter the replay up to the step limit (errata row
    25); `absorbing`: it starts again at once and its fall is worth r_fall / (1 - gamma)."""
    observation_scale: tuple[float, ...]
    """What each observation is divided by (errata row 35), see `NATURAL_SCALE`."""

    action_layer: int = 2
    """Hidden layer of the critic that the action enters at; 1 is the first."""
    reward_scale: float = 1.0
    """Factor on every reward."""
    fall_penalty: float = 0.0
    """Taken from the reward of every step that a bicycle lies, so that a fall costs
    fall_penalty / (1 - gamma) more; before `reward_scale`."""
    cost_cap: float = 0.0
    """Most that one step may cost, before `fall_penalty`; with a fall above it, turning round is
    never worth a fall. 0 caps nothing."""
    step_cost: float = 0.0
    """Taken from every reward, so that sooner is better also where the heading is right."""
    n_step: int = 1
    """Rewards summed before the critic's own estimate is used."""
    critics: int = 1
    """2: twin critics whose minimum is the target (TD3)."""
    smoothing: float = 0.0
    """Standard deviation of the noise on the target's action (TD3: 0.2)."""
    smoothing_clip: float = 0.5
    """Bound of that noise."""
    actor_every: int = 1
    """Critic updates per update of the actor and the targets (TD3: 2)."""
    actor_layer_norm: bool = False
    """Whether layer normalisation follows each hidden product of the actor."""
    critic_layer_norm: bool = False
    """The same for the critics; bounds what they extrapolate."""
    bound_values: bool = False
    """Whether targets are clipped to [reward_min / (1 - gamma), 0], all that can be true."""
    reward_min: float = -25.0
    """Least reward of a step, for `bound_values`; `fall_penalty` and
    `step_cost` are taken off it too."""
    huber: float = 0.0
    """Where the critic's loss turns from square to linear; 0 keeps it square."""
    grad_clip: float = 0.0
    """Largest norm of each network's gradient; 0 does not clip."""
    learning_rate_end: float = 1.0
    """Share of both learning rates that is left at the last step, reached in a straight line."""
    actor_average: float = 0.0
    """Share of the actor that enters, at each of its updates, the averaged actor that is scored
    and kept; 0 keeps the actor itself."""
    mirror: bool = False
    """Whether half of every batch is mirrored left to right (exact in corrected physics)."""
    saturation_penalty: float = 0.0
    """Weight of the squared pre-tanh outputs in the actor's loss."""
    bc_weight: float = 0.0
    """TD3+BC: weight of the squared distance to the stored action against normalised Q."""
    bc_alpha: float = 2.5
    """TD3+BC: what lambda = bc_alpha / mean|Q| is made of."""
    backend: str = "auto"
    """`fused` (hand-written gradients), `autograd`, or `auto`: fused where it can."""

    def __post_init__(self) -> None:
        for name in ("actor_hidden", "critic_hidden"):
            sizes = getattr(self, name)
            require(
                len(sizes) > 0 and min(sizes) > 0, f"{name} needs sizes above zero, not {sizes}"
            )
        for name in ("actor_learning_rate", "critic_learning_rate", "reward_scale", "bc_alpha"):
            _require_positive(name, getattr(self, name))
        for name in ("batch", "capacity", "n_step", "actor_every"):
            value = getattr(self, name)
            require(value >= 1, f"{name} must be at least 1, not {value!r}")
        not_negative = ("fall_penalty", "smoothing", "smoothing_clip", "huber", "grad_clip")
        for name in (*not_negative, "saturation_penalty", "bc_weight", "cost_cap", "step_cost"):
            _require_between(name, getattr(self, name), 0.0, math.inf)
        for name in ("tau", "learning_rate_end", "actor_average"):
            _require_between(name, getattr(self, name), 0.0, 1.0)
        require(0.0 <= self.gamma < 1.0, f"gamma must lie within 0 and below 1, not {self.gamma}")
        _require_between("reward_min", self.reward_min, -math.inf, 0.0)
        require(self.critics in (1, 2), f"critics must be 1 or 2, not {self.critics!r}")
        layers = len(self.critic_hidden)
        require(
            1 <= self.action_layer <= layers,
            f"action_layer must lie within 1 and {layers}, the critic's hidden layers,"
            f" not {self.action_layer!r}",
        )
        require(
            len(self.observation_scale) == 6 and min(self.observation_scale) > 0,
            f"observation_scale needs six values above zero, not {self.observation_scale}",
        )
        _require_choice("initialisation", self.initialisation, ("literal", "output", "fan_in"))
        _require_choice("fall", self.fall, ("frozen", "absorbing"))
        _require_choice("backend", self.backend, ("auto", "fused", "autograd"))

    @property
    def value_min(self) -> float:
        """Least value that can be true, in scaled reward."""
        least = self.reward_min - self.fall_penalty - self.step_cost
        return least * self.reward_scale / (1.0 - self.gamma)


@dataclass(frozen=True)
class NoiseConfig:
    """Exploration noise, in normalised actions (errata row 31).

    Raises:
        ValueError: on a value out of range.
    """

    kind: str
    """`ou` (Ornstein-Uhlenbeck, Table 3), `gaussian` or `none`."""
    sigma: float
    """Standard deviation of each step's random part (Table 3, errata row 31)."""
    theta: float
    """Pull of `ou` towards zero per step (Table 3)."""
    sigma_max: float = 0.0
    """When above `sigma`: the bicycles' sigmas are spread evenly from `sigma` to this."""

    def __post_init__(self) -> None:
        _require_choice("noise.kind", self.kind, ("ou", "gaussian", "none"))
        for name in ("sigma", "sigma_max"):
            _require_between(f"noise.{name}", getattr(self, name), 0.0, math.inf)
        _require_between("noise.theta", self.theta, 0.0, 1.0)


@dataclass(frozen=True)
class StartsConfig:
    """How training starts differ from the scenario's, which evaluation always uses.

    The six observations hold no distance, so a policy learns to pass close to a goal at any
    bearing only where such goals are seen often.

    Raises:
        ValueError: on a value out of range.
    """

    near_share: float = 0.0
    """Share of goals drawn near the bicycle at any bearing, instead of by the scenario."""
    near_distance: tuple[float, float] = (1.5, 15.0)
    """m, from and to, of those goals."""
    tilt: float = 0.0
    """rad, half width of the uniform start lean."""
    tilt_rate: float = 0.0
    """rad/s, half width of the start lean rate."""
    steer: float = 0.0
    """rad, half width of the start steering angle."""
    steer_rate: float = 0.0
    """rad/s, half width of the start steering rate."""
    any_speed: bool = False
    """Whether the start speed is drawn between the scenario's limits, where it has some."""
    ride_on: float = 0.0
    """Share of reached goals and time-outs after which the bicycle rides on from where it is
    to a new goal, instead of starting again."""
    max_steps: int = 0
    """Step limit of a training episode; 0 keeps the scenario's."""

    def __post_init__(self) -> None:
        for name in ("near_share", "ride_on"):
            _require_between(f"starts.{name}", getattr(self, name), 0.0, 1.0)
        for name in ("tilt", "tilt_rate", "steer", "steer_rate", "max_steps"):
            _require_between(f"starts.{name}", getattr(self, name), 0.0, math.inf)
        low, high = self.near_distance
        require(
            0 < low <= high, f"starts.near_distance must grow from above zero, not {low, high}"
        )


@dataclass(frozen=True)
class EvaluationConfig:
    """How a policy is scored while it trains: without noise, from fixed seeds, in one call.

    Raises:
        ValueError: on a value out of range.
    """

    every: int = 5_000
    """Updates between two evaluations."""
    episodes: int = 256
    """Starts per evaluation."""
    near_episodes: int = 0
    """Further starts with a goal within `near_distance`, where orbits show; they count by half."""
    near_distance: float = 12.0
    """m, half width of the square that those goals are drawn from, about the bicycle."""
    seed: int = 1_000_003
    """Of those starts, the same every time."""
    max_steps: int = 0
    """Step limit of its episodes; 0 keeps the scenario's."""
    stop_at: float = 0.0
    """Reach rate that ends the run; 0 never does."""
    stop_falls: float = 1.0
    """Largest fall rate at which `stop_at` ends the run."""

    def __post_init__(self) -> None:
        for name in ("every", "episodes"):
            value = getattr(self, name)
            require(value >= 1, f"evaluation.{name} must be at least 1, not {value!r}")
        for name in ("max_steps", "near_episodes"):
            _require_between(f"evaluation.{name}", getattr(self, name), 0, math.inf)
        _require_positive("evaluation.near_distance", self.near_distance)
        for name in ("stop_at", "stop_falls"):
            _require_between(f"evaluation.{name}", getattr(self, name), 0.0, 1.0)


@dataclass(frozen=True)
class RunConfig:
    """A whole training run.

    Raises:
        ValueError: on a value out of range.
    """

    ddpg: DdpgConfig
    noise: NoiseConfig
    steps: int
    """Environment steps, over all bicycles."""
    bicycles: int = 1
    """Bicycles stepped at once."""
    warm_up: int = 1_000
    """First environment steps, with actions drawn evenly (errata row 36)."""
    updates: int = 1
    """Updates after a step of all bicycles."""
    update_every: int = 1
    """Steps of all bicycles between two rounds of updates."""
    seed: int = 1
    scenario: Scenario = SCENARIOS["random-start-random-goal"]
    physics: Physics = field(default_factory=Physics)
    starts: StartsConfig = field(default_factory=StartsConfig)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)
    device: str = "cpu"
    """`cpu` or `cuda`."""
    threads: int = 1
    """Threads of torch; at these sizes more than one does not pay."""
    tensorboard: bool = True
    """Whether to write TensorBoard's files too, where it is installed."""
    log_every: int = 1_000
    """Updates between two lines of the log."""
    save_every: float = 30.0
    """s between two checkpoints; `kill -9` loses at most this much."""
    preset: str = ""
    """Name of the preset that this came from."""

    def __post_init__(self) -> None:
        for name in ("steps", "bicycles", "updates", "update_every", "threads", "log_every"):
            value = getattr(self, name)
            require(value >= 1, f"{name} must be at least 1, not {value!r}")
        for name in ("warm_up", "save_every", "seed"):
            _require_between(name, getattr(self, name), 0.0, math.inf)
        _require_choice("device", self.device, ("cpu", "cuda"))
