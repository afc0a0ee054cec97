"""What can be set on the controller; no ROS here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bicycle_controller.config import NoiseConfig
from bicycle_controller.controllers import Controller
from bicycle_controller.noise import Noise
from bicycle_controller.policy import DEFAULT_POLICY, LQR, load_controller
from bicycle_sim.settings import parameter


@dataclass(frozen=True)
class ControllerSettings:
    """The controller's ROS parameters."""

    policy: str = parameter(
        DEFAULT_POLICY,
        f"what rides: a policy file, a shipped policy's name, or one of {', '.join(LQR)}",
    )
    fallback: str = parameter(
        "lqr", "what rides where the policy fails: lqr, or zero input", choices=("lqr", "zero")
    )
    exploration: str = parameter(
        "none", "noise on the actions, to record data with", choices=("none", "ou", "gaussian")
    )
    exploration_sigma: float = parameter(
        0.1, "size of that noise, as a share of the action limits", 0.0, 10.0
    )
    exploration_theta: float = parameter(0.15, "pull of ou towards zero per step", 0.0, 1.0)
    seed: int = parameter(1, "of the exploration noise", 0, 2**62)
    goal_radius: float = parameter(
        0.0, "m within which a goal is reached; 0 takes the simulator's", 0.0, 100.0
    )
    goal_timeout: float = parameter(
        300.0, "simulated s after which a goal is given up; 0 is never", 0.0, 1e6
    )
    orbit_turns: float = parameter(
        2.0, "full turns without an approach after which a goal is missed", 0.5, 100.0
    )
    take_over: bool = parameter(True, "ride on a bicycle that is found riding, to the goal it had")
    diagnostics_period: float = parameter(1.0, "s", 0.1, 3600.0)

    def make_noise(self) -> Noise | None:
        """The exploration noise of one bicycle."""
        if self.exploration == "none":
            return None
        config = NoiseConfig(self.exploration, self.exploration_sigma, self.exploration_theta)
        return Noise(config, 1, 3, np.random.default_rng(self.seed))

    def make_fallback(self) -> Controller | None:
        """What rides where the policy fails."""
        return load_controller(self.fallback) if self.fallback == "lqr" else None
