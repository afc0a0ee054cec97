"""Learners of other libraries, set up as a competent user would, for `bench_goals.py`.

All of them ride the project's vector environment with natural observations, falls that end with
their value and a capped cost per step. `registered` starts are the scenario's own, `fast` starts
those of the preset (near goals, tilted bicycles).

    stock     the library's networks and settings, 64 bicycles, registered starts, 5-step returns,
              one update a step
    recipe    what makes the preset `fast` learn, as far as the learner has it: networks, layer
              norm, 128 bicycles, 5-step returns, tau, batch, noise, starts
    quick     the same with critics, batches and three updates a step of the preset `quick`
    ppo       PPO with stock networks and 64 bicycles; `tuned` has the learning rate, gamma and
              lambda that were the quickest of 14 trials with one seed
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bicycle_controller.config import loading
from bicycle_controller.config.algorithms import NATURAL_SCALE
from bicycle_controller.control.exploration_noise import Noise
from bicycle_sim.task.scenario import named
from bicycle_sim.task.training_variant import TrainingVariant

SCENARIO = "random-start-random-goal"
REGISTERED = TrainingVariant(
    near_share=0.0,
    tilt=0.0,
    tilt_rate=0.0,
    steer=0.0,
    steer_rate=0.0,
    any_speed=False,
    max_steps=400,
)
"""The scenario's own starts, with falls that end with their value and a capped cost."""
FAST = TrainingVariant()
"""Starts of the preset `fast`."""
PRESETS = {"recipe": "fast", "quick": "quick"}
"""Preset whose recipe a peer takes, by the kind of its set-up."""
PPO = {"n_steps": 128, "batch_size": 1024}
TUNED = {"learning_rate": 2e-3, "gamma": 0.98, "gae_lambda": 0.9}
SHORT = {"n_steps": 64, "batch_size": 512, "learning_rate": 1e-3}


@dataclass(frozen=True)
class SetUp:
    """One peer: whose learner it is, and how it is set up."""

    library: str
    """`stable_baselines3`, `sb3_contrib` or `sbx`."""
    algorithm: str
    """Name of the class."""
    kind: str
    """`stock`, `recipe`, `quick`, `ppo` or `untuned`."""
    starts: TrainingVariant = FAST
    options: dict[str, Any] = field(default_factory=dict)
    """Further options of the learner."""


PEERS = {
    "ppo-tuned": SetUp("stable_baselines3", "PPO", "ppo", REGISTERED, PPO | TUNED),
    "ppo-tuned-fast": SetUp("stable_baselines3", "PPO", "ppo", FAST, PPO | TUNED),
    "sbx-ppo": SetUp("sbx", "PPO", "ppo", REGISTERED, PPO | TUNED),
    "td3-recipe": SetUp("stable_baselines3", "TD3", "recipe"),
    "td3-quick": SetUp("stable_baselines3", "TD3", "quick"),
    "sbx-td3": SetUp("sbx", "TD3", "recipe"),
    "sbx-quick": SetUp("sbx", "TD3", "quick"),
    "sac-recipe": SetUp("stable_baselines3", "SAC", "recipe"),
    "sbx-sac": SetUp("sbx", "SAC", "recipe"),
    "crossq-recipe": SetUp("sb3_contrib", "CrossQ", "recipe"),
    "ppo-short": SetUp("stable_baselines3", "PPO", "ppo", REGISTERED, TUNED | SHORT),
    "ppo": SetUp("stable_baselines3", "PPO", "ppo", REGISTERED, PPO),
    "ppo-fast": SetUp("stable_baselines3", "PPO", "ppo", FAST, PPO),
    "td3": SetUp("stable_baselines3", "TD3", "stock", REGISTERED),
    "sac": SetUp("stable_baselines3", "SAC", "stock", REGISTERED),
    "tqc": SetUp("sb3_contrib", "TQC", "stock", REGISTERED),
    "untuned-td3": SetUp("stable_baselines3", "TD3", "untuned", REGISTERED),
}
"""Peers by name; the last one is set up as nobody should: one bicycle, frozen falls, no cap."""


class PeerController:
    """An actor of another library as a controller."""

    policy_id = "peer"

    def __init__(self, model: Any, rows: tuple[int, ...]) -> None:
        """Wrap a model that sees natural observations and gives shares of the limits.

        Args:
            model: the learner.
            rows: numbers of bicycles that are asked for at first, from the least on.
        """
        self.model, self.limits = model, named(SCENARIO).action_limits
        self.rows = rows
        self.padded = type(model).__module__.startswith("sbx")

    def act(self, observation: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Physical actions (N, 3), without exploration."""
        count = len(observation)
        # SBX compiles anew for each number of rows, which falls as rides end.
        rows = next(goals for goals in self.rows if count <= goals) if self.padded else count
        scaled = np.zeros((rows, 6), np.float32)
        scaled[:count] = observation / np.array(NATURAL_SCALE)
        action = np.zeros((count, 3))
        found = self.model.predict(scaled, deterministic=True)[0][:count]
        action[:, :2] = np.clip(found, -1.0, 1.0)
        return action * self.limits


def model_of(name: str, seed: int) -> Any:
    """Return a peer before its first step.

    Raises:
        ModuleNotFoundError: without its library.
    """
    import importlib

    import gymnasium  # noqa: F401  # before the environments, which it names

    peer = PEERS[name]
    learner = getattr(importlib.import_module(peer.library), peer.algorithm)
    options: dict[str, Any] = {"seed": seed, "device": "cpu", "verbose": 0} | peer.options
    if peer.kind == "untuned":
        return learner("MlpPolicy", _one_bicycle(), **options)
    if peer.kind == "ppo":
        return learner("MlpPolicy", _bicycles(64, peer.starts), **options)
    if peer.kind == "stock":
        steps = {"train_freq": 1, "gradient_steps": 1, "learning_starts": 6400, "n_steps": 5}
        return learner("MlpPolicy", _bicycles(64, peer.starts), **steps, **options)
    policy, taken = _recipe(peer, seed)
    return learner(policy, _bicycles(128, peer.starts), **taken, **options)


def _recipe(peer: SetUp, seed: int) -> tuple[Any, dict[str, Any]]:
    """Return the policy and the options that give an off-policy peer the recipe of a preset."""
    config = loading.preset(PRESETS[peer.kind])
    ddpg = config.ddpg
    assert ddpg is not None
    networks: dict[str, Any] = {
        "net_arch": {"pi": list(ddpg.actor_hidden), "qf": list(ddpg.critic_hidden)}
    }
    taken: dict[str, Any] = {
        "learning_rate": ddpg.critic_learning_rate,
        "learning_starts": config.warm_up,
        "batch_size": ddpg.batch,
        "gamma": ddpg.gamma,
        "n_steps": ddpg.n_step,
        "train_freq": 1,
        "gradient_steps": config.updates,
    }
    policy: Any = "MlpPolicy"
    if peer.library == "sbx":
        networks["layer_norm"] = True
    if peer.library == "stable_baselines3":
        networks["optimizer_kwargs"] = {"fused": True}
    if peer.algorithm == "TD3":
        taken |= {"policy_delay": 1, "action_noise": _noise(config.bicycles, seed)}
        if peer.library == "stable_baselines3":
            taken |= {"target_policy_noise": 0.05, "target_noise_clip": 0.1}
            policy = _normed_policy()
    if peer.algorithm != "CrossQ":  # which has no target network, and normalises batches
        taken["tau"] = ddpg.tau
    return policy, taken | {"policy_kwargs": networks}


def _bicycles(count: int, variant: TrainingVariant) -> Any:
    """Return the project's vector environment for stable-baselines3."""
    from bicycle_sim.task.sb3 import BicycleVecEnv

    return BicycleVecEnv(
        f"bicycle/{SCENARIO}-v0", count, variant=variant, observation_scale="natural"
    )


def _one_bicycle() -> Any:
    """Return one bicycle, with frozen falls and costs without a cap."""
    from stable_baselines3.common.env_util import make_vec_env

    keywords = {"observation_scale": "natural", "max_episode_steps": 400}
    return make_vec_env(f"bicycle/{SCENARIO}-v0", env_kwargs=keywords)


def _noise(count: int, seed: int) -> Any:
    """Return the exploration noise of `fast` for `count` bicycles, sampled in one call."""
    from stable_baselines3.common.noise import VectorizedActionNoise

    config = loading.preset("fast").noise

    class OneCall(VectorizedActionNoise):
        def __init__(self) -> None:
            self.noise = Noise(config, count, 2, np.random.default_rng(seed))

        def __call__(self) -> np.ndarray:
            return self.noise.sample()

        def reset(self, indices: Any = None) -> None:
            ended = np.zeros(count, bool)
            ended[slice(None) if indices is None else indices] = True
            self.noise.reset(ended)

    return OneCall()


def _normed_policy() -> Any:
    """Return stable-baselines3's policy of TD3 with layer norm in the critics, as SBX has it."""
    from stable_baselines3.common.policies import ContinuousCritic
    from stable_baselines3.td3.policies import TD3Policy
    from torch import nn

    def normed(network: nn.Sequential) -> nn.Sequential:
        """Return the network with its hidden layers normalised before their nonlinearity."""
        layers: list[nn.Module] = []
        for layer in network:
            layers.append(layer)
            if isinstance(layer, nn.Linear) and layer.out_features > 1:
                layers.append(nn.LayerNorm(layer.out_features))
        return nn.Sequential(*layers)

    class NormedCritic(ContinuousCritic):
        def __init__(self, *values: Any, **options: Any) -> None:
            super().__init__(*values, **options)
            for index, network in enumerate(self.q_networks):
                self.q_networks[index] = normed(network)
                setattr(self, f"qf{index}", self.q_networks[index])

    class NormedPolicy(TD3Policy):
        def make_critic(self, features_extractor: Any = None) -> Any:
            """Return a critic with layer norm."""
            options = self._update_features_extractor(self.critic_kwargs, features_extractor)
            return NormedCritic(**options).to(self.device)

    return NormedPolicy
