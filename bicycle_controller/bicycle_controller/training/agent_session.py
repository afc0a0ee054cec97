"""Common part of online and offline runs of an agent: its actor, the best policy, its metadata."""

from __future__ import annotations

import json
import re
from typing import Any

from bicycle_common.observation import ACTION_FIELDS, OBSERVATION_FIELDS
from bicycle_controller.agents.networks import policy_tensors
from bicycle_controller.config.algorithms import DdpgConfig
from bicycle_controller.config.run import RunConfig
from bicycle_controller.evaluation.score import Score
from bicycle_controller.policy.policy import Policy, PolicyInfo, save_policy
from bicycle_controller.policy.trained_for import TOO
from bicycle_controller.training.factory import make_agent
from bicycle_controller.training.run_folder import RunFolder
from bicycle_controller.training.session import TrainingSession


def _inputs(config: RunConfig) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """Return the names of the actor's inputs, and the divisor of each in SI units."""
    learner = config.learner
    if not isinstance(learner, DdpgConfig):
        return OBSERVATION_FIELDS, learner.observation_scale
    limits = dict(zip(ACTION_FIELDS, config.scenario.action_limits.tolist(), strict=True))
    fields = (name.partition("[")[0] for name in learner.inputs)
    pairs = zip(fields, learner.actor_scale, strict=True)
    return learner.inputs, tuple(limits.get(name) or scale for name, scale in pairs)


class AgentSession(TrainingSession[Score]):
    """Run of DDPG, NAF or PPO; subclasses define the source of its transitions."""

    score_type = Score

    def __init__(self, config: RunConfig, files: RunFolder, device: str) -> None:
        """Initialise the networks on `device`."""
        super().__init__(config, files)
        self.config = config
        self.agent = make_agent(config, device)

    def keep(self, policy: Policy, found: Score, acceptable: bool = True) -> bool:
        """Write a policy as the last one, and as the best if it is; return True if it is."""
        better = acceptable and (self.best is None or found.rank > self.best.rank)
        if better:
            self.best = found
            save_policy(policy, self.files.best)
        save_policy(policy, self.files.last)
        if self.config.evaluation.keep:
            self.files.keep(policy, self.updates, self.config.evaluation.keep)
        return better

    def meets_goal(self, found: Score) -> bool:
        """Return True if the run may end with a policy of this score."""
        limits = self.config.evaluation
        good = found.reach_rate >= limits.stop_at and found.fall_rate <= limits.stop_falls
        return limits.stop_at > 0 and good

    def policy_of(self, kind: str, about: dict[str, Any]) -> Policy:
        """Return the current actor with its metadata.

        Args:
            kind: name of the algorithm, for people.
            about: further metadata of its training.
        """
        config = self.config
        trained = {"algorithm": kind, "preset": config.preset, "seed": config.seed} | about
        if config.physics_too is not None:
            trained[TOO] = json.loads(config.physics_too.to_json())
        name = f"{config.preset or kind}-{config.scenario.name}-{config.seed}"
        inputs, scale = _inputs(config)
        info = PolicyInfo(
            name=re.sub(r"[^A-Za-z0-9._-]", "-", name)[:64],
            scenario=config.scenario,
            plant=config.physics,
            observation_scale=scale,
            inputs=inputs,
            speeds=config.starts.speeds,
            action_limits=tuple(config.scenario.action_limits.tolist()),
            trained=trained | self.made_by,
        )
        return Policy(info, policy_tensors(self.agent.deployed))

    def state_dict(self) -> dict[str, Any]:
        """Return everything in this class that future numbers depend on."""
        return super().state_dict() | {"agent": self.agent.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`, to the bit."""
        super().load_state_dict(state)
        self.agent.load_state_dict(state["agent"])
