"""What each learning algorithm is made of: frozen dataclasses, validated on creation.

What the paper's Tables 2 and 3 give has no default here: its one home is `presets/`. Everything
that goes beyond the paper is a switch that is off by default.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

from bicycle_common.validation import (
    require,
    require_between,
    require_choice,
    require_layers,
    require_positive,
    require_scale,
)

CRITIC_EXTRAS = {"speed": 3.0, "goal_distance": 10.0}
"""What a critic may see beside the six observations, and what it is divided by: m/s and m."""

NATURAL_SCALE = (0.8, 3.0, 0.3, 1.0, 5.0, 2.0)
"""Natural ranges of the six observations, in the order of `task.OBSERVATION_FIELDS`."""


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
    critic_sees: tuple[str, ...] = ()
    """Which of `CRITIC_EXTRAS` the critics see too while they learn; the actor never does, so it
    rides from the six observations (asymmetric actor-critic, Pinto et al. 2018)."""
    critics: int = 1
    """2: twin critics whose minimum is the target (TD3)."""
    smoothing: float = 0.0
    """Standard deviation of the noise on the target's action (TD3: 0.2)."""
    smoothing_clip: float = 0.5
    """Bound of that noise."""
    actor_every: int = 1
    """Critic updates per update of the actor and the targets (TD3: 2)."""
    symmetric_actor: bool = False
    """Whether the actor does to the left what it does to the right, mirrored: it then has no side
    that it leans or weaves to, and rides straight at a goal ahead. Its policy file is twice as
    wide."""
    actor_layer_norm: bool = False
    """Whether layer normalisation follows each hidden product of the actor."""
    critic_layer_norm: bool = False
    """The same for the critics; bounds what they extrapolate."""
    bound_values: bool = False
    """Whether targets are clipped to [reward_min / (1 - gamma), 0], all that can be true."""
    reward_min: float = -25.0
    """Least reward of a step, shaping included, for `bound_values`; `fall_penalty` and
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
    bc_to: str = "recorded"
    """Which action that is: the `recorded` one, exploration and all, or what the run's `teacher`
    would have done in that state, whoever rode (Ross et al. 2011, DAgger)."""
    bc_alpha: float = 2.5
    """TD3+BC: what lambda = bc_alpha / mean|Q| is made of."""
    backend: str = "auto"
    """`autograd`; `fused`: hand-written gradients in torch; `native`: the same in C++; `auto`: the
    fastest that works here. Their numbers differ by rounding."""

    def __post_init__(self) -> None:
        for name in ("actor_hidden", "critic_hidden"):
            require_layers(name, getattr(self, name))
        for name in ("actor_learning_rate", "critic_learning_rate", "reward_scale", "bc_alpha"):
            require_positive(name, getattr(self, name))
        for name in ("batch", "capacity", "n_step", "actor_every"):
            value = getattr(self, name)
            require(value >= 1, f"{name} must be at least 1, not {value!r}")
        not_negative = ("fall_penalty", "smoothing", "smoothing_clip", "huber", "grad_clip")
        for name in (*not_negative, "saturation_penalty", "bc_weight", "cost_cap", "step_cost"):
            require_between(name, getattr(self, name), 0.0, math.inf)
        for name in ("tau", "learning_rate_end", "actor_average"):
            require_between(name, getattr(self, name), 0.0, 1.0)
        require(0.0 <= self.gamma < 1.0, f"gamma must lie within 0 and below 1, not {self.gamma}")
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
        require_scale("observation_scale", self.observation_scale)
        for name in self.critic_sees:
            require_choice("critic_sees", name, tuple(CRITIC_EXTRAS))
        require_choice("initialisation", self.initialisation, ("literal", "output", "fan_in"))
        require_choice("fall", self.fall, ("frozen", "absorbing"))
        require_choice("bc_to", self.bc_to, ("recorded", "teacher"))
        require_choice("backend", self.backend, ("auto", "native", "fused", "autograd"))

    @property
    def critic_scale(self) -> tuple[float, ...]:
        """What each number that the critics see of a state is divided by."""
        return (*self.observation_scale, *(CRITIC_EXTRAS[name] for name in self.critic_sees))

    @property
    def value_min(self) -> float:
        """Least value that can be true, in scaled reward."""
        least = self.reward_min - self.fall_penalty - self.step_cost
        return least * self.reward_scale / (1.0 - self.gamma)


@dataclass(frozen=True)
class NafConfig:
    """Normalised advantage functions (section 5.2 of the paper; Gu et al. 2016).

    Raises:
        ValueError: on a value out of range.
    """

    hidden: tuple[int, ...]
    """Units of the hidden layers that V, mu and L share."""
    learning_rate: float
    """Adam's step."""
    initialisation: str
    """Of the hidden layers and of mu, as in `DdpgConfig`; V and L start within 3e-3."""
    tau: float
    """Share of the network that enters its target at each update."""
    gamma: float
    """Discount per step (Table 3)."""
    batch: int
    """Transitions per update (Table 3)."""
    capacity: int
    """Transitions that the replay memory holds (Table 3)."""
    fall: str
    """`frozen` or `absorbing`, as in `DdpgConfig`."""
    observation_scale: tuple[float, ...]
    """What each observation is divided by, see `NATURAL_SCALE`."""

    reward_scale: float = 1.0
    """Factor on every reward."""
    fall_penalty: float = 0.0
    """Taken from the reward of every step that a bicycle lies, before `reward_scale`."""
    cost_cap: float = 0.0
    """Most that one step may cost, before `fall_penalty`; 0 caps nothing."""
    step_cost: float = 0.0
    """Taken from the reward of every step, before `reward_scale`."""
    n_step: int = 1
    """Rewards summed before the network's own estimate is used."""
    grad_clip: float = 0.0
    """Largest norm of the gradient; 0 does not clip."""
    learning_rate_end: float = 1.0
    """Share of the learning rate that is left at the last step, reached in a straight line."""

    def __post_init__(self) -> None:
        require_layers("hidden", self.hidden)
        for name in ("batch", "capacity", "n_step"):
            value = getattr(self, name)
            require(value >= 1, f"{name} must be at least 1, not {value!r}")
        require_between("tau", self.tau, 0.0, 1.0)
        require_choice("initialisation", self.initialisation, ("literal", "output", "fan_in"))
        _check_shared(self)


@dataclass(frozen=True)
class PpoConfig:
    """Proximal policy optimisation (section 5.2 of the paper; Schulman et al. 2017).

    Raises:
        ValueError: on a value out of range.
    """

    n_step: ClassVar[int] = 1
    """Transitions are kept step by step; the advantages sum them."""

    hidden: tuple[int, ...]
    """Units of the hidden layers, of the policy's and of the value's network."""
    shared: bool
    """Whether both networks share those layers."""
    learning_rate: float
    """Adam's step."""
    rollout: int
    """Steps of every bicycle between two rounds of updates."""
    epochs: int
    """Times that every transition of a rollout is used."""
    batch: int
    """Transitions per update."""
    gamma: float
    """Discount per step (Table 3)."""
    gae_lambda: float
    """Weight of longer returns in the advantage (Schulman et al. 2016)."""
    clip: float
    """epsilon: the ratio counts within 1 - epsilon and 1 + epsilon only."""
    value_weight: float
    """c_1, weight of the value's squared error."""
    entropy_weight: float
    """c_2, weight of the entropy."""
    grad_clip: float
    """Largest norm of the gradient; 0 does not clip."""
    log_std: float
    """Start of the logarithm of the policy's standard deviation, in normalised actions."""
    normalise_advantages: bool
    """Whether the advantages of each minibatch are shifted and scaled to mean 0 and deviation
    1."""
    fall: str
    """`frozen` or `absorbing`, as in `DdpgConfig`."""
    observation_scale: tuple[float, ...]
    """What each observation is divided by, see `NATURAL_SCALE`."""

    reward_scale: float = 1.0
    """Factor on every reward."""
    fall_penalty: float = 0.0
    """Taken from the reward of every step that a bicycle lies, before `reward_scale`."""
    cost_cap: float = 0.0
    """Most that one step may cost, before `fall_penalty`; 0 caps nothing."""
    step_cost: float = 0.0
    """Taken from the reward of every step, before `reward_scale`."""
    learning_rate_end: float = 1.0
    """Share of the learning rate that is left at the last step, reached in a straight line."""

    def __post_init__(self) -> None:
        require_layers("hidden", self.hidden)
        for name in ("rollout", "epochs", "batch"):
            value = getattr(self, name)
            require(value >= 1, f"{name} must be at least 1, not {value!r}")
        require_between("gae_lambda", self.gae_lambda, 0.0, 1.0)
        require_positive("clip", self.clip)
        require_between("log_std", self.log_std, -10.0, 2.0)
        for name in ("value_weight", "entropy_weight"):
            require_between(name, getattr(self, name), 0.0, math.inf)
        _check_shared(self)


LearnerConfig: TypeAlias = DdpgConfig | NafConfig | PpoConfig
"""The part of a run that belongs to its algorithm."""


def _check_shared(config: NafConfig | PpoConfig) -> None:
    """What the baselines have in common."""
    for name in ("learning_rate", "reward_scale"):
        require_positive(name, getattr(config, name))
    for name in ("fall_penalty", "cost_cap", "step_cost", "grad_clip"):
        require_between(name, getattr(config, name), 0.0, math.inf)
    require_between("learning_rate_end", config.learning_rate_end, 0.0, 1.0)
    gamma = config.gamma
    require(0.0 <= gamma < 1.0, f"gamma must lie within 0 and below 1, not {gamma}")
    require_scale("observation_scale", config.observation_scale)
    require_choice("fall", config.fall, ("frozen", "absorbing"))
