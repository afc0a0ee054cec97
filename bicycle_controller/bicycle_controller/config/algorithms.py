"""Configurations of the learning algorithms: frozen dataclasses, validated on creation.

Values of the paper's Tables 2 and 3 have no default here: they stand only in `presets/`.
Everything beyond the paper is a switch that is off by default.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

from bicycle_common.observation import OBSERVATION_FIELDS
from bicycle_common.validation import (
    require,
    require_between,
    require_choice,
    require_layers,
    require_positive,
    require_scale,
)

CRITIC_EXTRAS = {"speed": 3.0, "goal_distance": 10.0, "delay": 2.0, "physics_too": 1.0}
"""Extra inputs of a critic beside the actor's, and their divisors: m/s, m, steps by which actions
are late, and 1 for a bicycle of `physics_too`."""

SPEED_SCALE = 3.0
"""m/s, divisor of a speed that the actor sees."""

MOST_PERIODS = 100

NATURAL_SCALE = (0.8, 3.0, 0.3, 1.0, 5.0, 2.0)
"""Natural ranges of the six observations, in the order of `task.OBSERVATION_FIELDS`."""


@dataclass(frozen=True, kw_only=True)
class AlgorithmConfig:
    """Fields of every algorithm: the value of a reward, and the scale of an observation.

    Raises:
        ValueError: on a value out of range.
    """

    gamma: float
    """Discount per step (Table 3)."""
    fall: str
    """`frozen`: the fallen bicycle's steps enter the replay up to the step limit (errata row
    25); `absorbing`: it starts again at once and its fall is worth r_fall / (1 - gamma)."""
    observation_scale: tuple[float, ...]
    """Divisor of each observation (errata row 35), see `NATURAL_SCALE`."""
    reward_scale: float = 1.0
    """Factor on every reward."""
    fall_penalty: float = 0.0
    """Subtracted from the reward of every step in which a bicycle lies, so that a fall costs
    fall_penalty / (1 - gamma) more; before `reward_scale`."""
    cost_cap: float = 0.0
    """Largest cost of one step, before `fall_penalty`; if a fall costs more, turning round is
    never worth a fall. 0 disables the cap."""
    step_cost: float = 0.0
    """Subtracted from every reward, so that an early arrival pays even with the right heading;
    before `reward_scale`."""
    learning_rate_end: float = 1.0
    """Final share of the learning rates, reached linearly at the last step."""

    def __post_init__(self) -> None:
        require_positive("reward_scale", self.reward_scale)
        for name in ("fall_penalty", "cost_cap", "step_cost"):
            require_between(name, getattr(self, name), 0.0, math.inf)
        require_between("learning_rate_end", self.learning_rate_end, 0.0, 1.0)
        require(0.0 <= self.gamma < 1.0, f"gamma must lie within 0 and below 1, not {self.gamma}")
        require_scale("observation_scale", self.observation_scale)
        require_choice("fall", self.fall, ("frozen", "absorbing"))


@dataclass(frozen=True)
class DdpgConfig(AlgorithmConfig):
    """Deep deterministic policy gradient (section 4 of the paper) and its optional extensions.

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
    batch: int
    """Transitions per update (Table 3)."""
    capacity: int
    """Capacity of the replay memory, in transitions (Table 3)."""

    action_layer: int = 2
    """Hidden layer of the critic at which the action enters; 1 is the first."""
    n_step: int = 1
    """Rewards summed before the critic's own estimate is used."""
    sees: tuple[str, ...] = OBSERVATION_FIELDS
    """Names of the actor's inputs in every state, see `policy.inputs`; the paper's six."""
    remembers: tuple[str, ...] = ()
    """Fields that it sees of each of the last `periods` control periods, too."""
    periods: int = 0
    """Control periods that it remembers; its own commands of as many periods as an action is late
    make a late action's outcome foreseeable."""
    critic_sees: tuple[str, ...] = ()
    """Subset of `CRITIC_EXTRAS` that the critics see during training beside the actor's inputs;
    the actor never does (asymmetric actor-critic, Pinto et al. 2018)."""
    critics: int = 1
    """2: twin critics whose minimum is the target (TD3)."""
    smoothing: float = 0.0
    """Standard deviation of the noise on the target's action (TD3: 0.2)."""
    smoothing_clip: float = 0.5
    """Bound of that noise."""
    actor_every: int = 1
    """Critic updates per update of the actor and the targets (TD3: 2)."""
    symmetric_actor: bool = False
    """True if the actor's left and right are mirror images: it then prefers no side, and rides
    straight at a goal ahead. Its policy file is twice as wide."""
    actor_layer_norm: bool = False
    """True if layer normalisation follows each hidden product of the actor."""
    critic_layer_norm: bool = False
    """Same for the critics; bounds their extrapolation."""
    bound_values: bool = False
    """True to clip targets to [reward_min / (1 - gamma), 0], the range of possible values."""
    reward_min: float = -25.0
    """Least reward of a step, shaping included, for `bound_values`; `fall_penalty` and `step_cost`
    are subtracted from it too."""
    huber: float = 0.0
    """Error at which the critic's loss changes from square to linear; 0 keeps it square."""
    grad_clip: float = 0.0
    """Largest norm of each network's gradient; 0 disables clipping."""
    actor_average: float = 0.0
    """Share of the actor blended, at each of its updates, into the averaged actor that is scored
    and kept; 0 keeps the actor itself."""
    mirror: bool = False
    """True if half of every batch is mirrored left to right (exact in corrected physics)."""
    saturation_penalty: float = 0.0
    """Weight of the squared pre-tanh outputs in the actor's loss."""
    bc_weight: float = 0.0
    """TD3+BC: weight of the squared distance to the stored action against normalised Q."""
    bc_to: str = "recorded"
    """Target action of that term: the `recorded` one, including exploration, or the one that the
    run's `teacher` would choose in that state, whoever rode (Ross et al. 2011, DAgger)."""
    bc_alpha: float = 2.5
    """TD3+BC: numerator of lambda = bc_alpha / mean|Q|."""
    backend: str = "auto"
    """`autograd`; `fused`: hand-written gradients in torch; `native`: the same in C++; `auto`: the
    fastest that is available. Their numbers differ by rounding."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("actor_hidden", "critic_hidden"):
            require_layers(name, getattr(self, name))
        for name in ("actor_learning_rate", "critic_learning_rate", "bc_alpha"):
            require_positive(name, getattr(self, name))
        for name in ("batch", "capacity", "n_step", "actor_every"):
            value = getattr(self, name)
            require(value >= 1, f"{name} must be at least 1, not {value!r}")
        not_negative = ("smoothing", "smoothing_clip", "huber", "grad_clip")
        for name in (*not_negative, "saturation_penalty", "bc_weight"):
            require_between(name, getattr(self, name), 0.0, math.inf)
        for name in ("tau", "actor_average"):
            require_between(name, getattr(self, name), 0.0, 1.0)
        require_between("reward_min", self.reward_min, -math.inf, 0.0)
        require(self.critics in (1, 2), f"critics must be 1 or 2, not {self.critics!r}")
        require(
            not (self.symmetric_actor and self.actor_layer_norm),
            "symmetric_actor cannot have actor_layer_norm: no plain network does the same",
        )
        layers = len(self.critic_hidden)
        require(
            1 <= self.action_layer <= layers,
            f"action_layer must lie within 1 and {layers}, the critic's hidden layers,"
            f" not {self.action_layer!r}",
        )
        require_between("periods", self.periods, 0, MOST_PERIODS)
        require(
            bool(self.remembers) == (self.periods > 0),
            "a memory needs both ddpg.remembers and ddpg.periods, or neither",
        )
        for name in self.critic_sees:
            require_choice("critic_sees", name, tuple(CRITIC_EXTRAS))
        require_choice("initialisation", self.initialisation, ("literal", "output", "fan_in"))
        require_choice("bc_to", self.bc_to, ("recorded", "teacher"))
        require_choice("backend", self.backend, ("auto", "native", "fused", "autograd"))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the actor's inputs."""
        past = (f"{n}[-{age}]" for age in range(1, self.periods + 1) for n in self.remembers)
        return (*self.sees, *past)

    @property
    def actor_scale(self) -> tuple[float, ...]:
        """Divisor of each of the actor's inputs; commands count as shares of their limits."""
        known = dict(zip(OBSERVATION_FIELDS, self.observation_scale, strict=True))
        known["speed"] = SPEED_SCALE
        return tuple(known.get(name.partition("[")[0], 1.0) for name in self.inputs)

    @property
    def actor_mirror(self) -> tuple[float, ...]:
        """Factor of each input in a mirror: 1 for speed and pedal force, else -1."""
        kept = ("speed", "pedal_force")
        return tuple(1.0 if name.partition("[")[0] in kept else -1.0 for name in self.inputs)

    @property
    def critic_scale(self) -> tuple[float, ...]:
        """Divisor of each number of a state that the critics see."""
        return (*self.actor_scale, *(CRITIC_EXTRAS[name] for name in self.critic_sees))

    @property
    def value_min(self) -> float:
        """Least possible value, in scaled reward."""
        least = self.reward_min - self.fall_penalty - self.step_cost
        return least * self.reward_scale / (1.0 - self.gamma)


@dataclass(frozen=True)
class NafConfig(AlgorithmConfig):
    """Normalised advantage functions (section 5.2 of the paper; Gu et al. 2016).

    Raises:
        ValueError: on a value out of range.
    """

    hidden: tuple[int, ...]
    """Units of the hidden layers shared by V, mu and L."""
    learning_rate: float
    """Adam's step."""
    initialisation: str
    """Start of the hidden layers and of mu, as in `DdpgConfig`; V and L start within 3e-3."""
    tau: float
    """Share of the network blended into its target at each update."""
    batch: int
    """Transitions per update (Table 3)."""
    capacity: int
    """Capacity of the replay memory, in transitions (Table 3)."""

    n_step: int = 1
    """Rewards summed before the network's own estimate is used."""
    grad_clip: float = 0.0
    """Largest norm of the gradient; 0 disables clipping."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_layers("hidden", self.hidden)
        for name in ("batch", "capacity", "n_step"):
            value = getattr(self, name)
            require(value >= 1, f"{name} must be at least 1, not {value!r}")
        require_between("tau", self.tau, 0.0, 1.0)
        require_choice("initialisation", self.initialisation, ("literal", "output", "fan_in"))
        require_positive("learning_rate", self.learning_rate)
        require_between("grad_clip", self.grad_clip, 0.0, math.inf)


@dataclass(frozen=True)
class PpoConfig(AlgorithmConfig):
    """Proximal policy optimisation (section 5.2 of the paper; Schulman et al. 2017).

    Raises:
        ValueError: on a value out of range.
    """

    n_step: ClassVar[int] = 1
    """Transitions are stored step by step; the advantages sum them."""

    hidden: tuple[int, ...]
    """Units of the hidden layers of the policy's and of the value's network."""
    shared: bool
    """True if both networks share those layers."""
    learning_rate: float
    """Adam's step."""
    rollout: int
    """Steps of every bicycle between two rounds of updates."""
    epochs: int
    """Number of times that every transition of a rollout is used."""
    batch: int
    """Transitions per update."""
    gae_lambda: float
    """Weight of longer returns in the advantage (Schulman et al. 2016)."""
    clip: float
    """epsilon: the ratio counts only between 1 - epsilon and 1 + epsilon."""
    value_weight: float
    """c_1, weight of the value's squared error."""
    entropy_weight: float
    """c_2, weight of the entropy."""
    grad_clip: float
    """Largest norm of the gradient; 0 disables clipping."""
    log_std: float
    """Initial logarithm of the policy's standard deviation, in normalised actions."""
    normalise_advantages: bool
    """True to normalise the advantages of each minibatch to mean 0 and deviation 1."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_layers("hidden", self.hidden)
        for name in ("rollout", "epochs", "batch"):
            value = getattr(self, name)
            require(value >= 1, f"{name} must be at least 1, not {value!r}")
        require_between("gae_lambda", self.gae_lambda, 0.0, 1.0)
        require_positive("clip", self.clip)
        require_between("log_std", self.log_std, -10.0, 2.0)
        for name in ("value_weight", "entropy_weight"):
            require_between(name, getattr(self, name), 0.0, math.inf)
        require_positive("learning_rate", self.learning_rate)
        require_between("grad_clip", self.grad_clip, 0.0, math.inf)


LearnerConfig: TypeAlias = DdpgConfig | NafConfig | PpoConfig
"""Part of a run that belongs to its algorithm."""
