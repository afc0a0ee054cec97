"""Updates from a replay memory that others fill: with recorded rides, or live ones.

Candidates are evaluated as in `online`: they ride in the vectorised simulator from fixed starts,
and the best is kept, judged by rides and never by losses.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch

from bicycle_common.observation import OBSERVATION_FIELDS
from bicycle_controller.config.algorithms import DdpgConfig
from bicycle_controller.config.run import RunConfig, ShapingConfig
from bicycle_controller.data.replay_buffer import ReplayBuffer
from bicycle_controller.evaluation.score import Score, score
from bicycle_controller.policy.policy import Policy
from bicycle_controller.training import checkpoint
from bicycle_controller.training.agent_session import AgentSession
from bicycle_controller.training.logger import Logger, Progress
from bicycle_controller.training.run_folder import RunFolder
from bicycle_controller.training.session import usable_device

CHUNK = 10
"""Updates between two checks of the clock and of signals; their batches are drawn at once."""


@dataclass(frozen=True)
class Candidate:
    """One evaluated actor."""

    policy: Policy
    score: Score
    q_policy: float | None
    """Mean Q of its own actions, in scaled reward; None before it is measured."""
    kept: bool
    """True if it is the best so far, in `best.safetensors`."""

    @property
    def overestimates(self) -> bool:
        """True if the critic's mean Q is above 0, the largest possible return."""
        return self.q_policy is not None and self.q_policy > 0


def ddpg_of(config: RunConfig) -> DdpgConfig:
    """Return the DDPG configuration of a run that can learn from another policy's actions.

    Raises:
        ValueError: on another algorithm, or if it needs data that bags do not contain.
    """
    foreign = {
        "ddpg.critic_sees": config.ddpg is not None and config.ddpg.critic_sees,
        "ddpg.sees": config.ddpg is not None and config.ddpg.inputs != OBSERVATION_FIELDS,
        "shaping": config.shaping != ShapingConfig(),
        "teacher": config.teacher.share > 0,
    }
    for name, wanted in foreign.items():
        if wanted:
            raise ValueError(
                f"{name} works in simulation only, not with recorded or live rides: choose a"
                " preset without it, such as offline"
            )
    if config.ddpg is None:
        raise ValueError(
            f"{config.algorithm} cannot learn from recorded rides: choose a preset with ddpg, such"
            " as offline"
        )
    return config.ddpg


class Learner(AgentSession):
    """A run whose replay memory is filled by its caller.

    Attributes:
        replay: the memory.
        rejected: candidates rejected because their critic overestimates.
        q_policy: mean Q of the actor's own actions, in scaled reward.
        last: score of the last candidate of this call, kept or not.
    """

    def __init__(self, config: RunConfig, files: RunFolder, replay: ReplayBuffer) -> None:
        """Initialise the networks; `replay` may be filled later."""
        super().__init__(config, files, usable_device(config.device))
        self.replay = replay
        self.rejected = 0
        self.q_policy: float | None = None
        self.last: Score | None = None

    unit = "update"

    @property
    def done(self) -> int:
        """Updates made."""
        return self.updates

    @property
    def budget(self) -> int:
        """Updates to be made."""
        return self.config.offline_updates

    def step(self, log: Logger, bar: Progress) -> None:
        """Make the next updates of the budget; the last candidate is always scored."""
        budget = self.config.offline_updates
        count = min(CHUNK, budget - self.updates)
        self.advance(log, count, self.updates / budget)
        self.evaluation_due |= self.finished
        bar.advance(count)

    def advance(self, log: Logger, count: int = CHUNK, progress: float = 0.0) -> None:
        """Make `count` updates; `progress` is the finished share of the run."""
        before = self.updates
        self.agent.anneal(progress)
        self.agent.update(self.replay, count)
        self.updates += count
        self.evaluation_due = self.crossed(self.config.evaluation.every, before)
        if self.crossed(self.config.log_every, before) or self.evaluation_due:
            row = self.agent.metrics()
            self.q_policy = row.get("q_policy", self.q_policy)
            log.write("learn", self.updates, self.row(row))

    def score_actor(self) -> Score:
        """Return the score of the actor's rides from the fixed starts.

        Raises:
            RuntimeError: if learning has diverged.
        """
        config = self.config
        if not all(torch.isfinite(item).all() for item in self.agent.actor.parameters()):
            raise RuntimeError(
                f"learning has diverged after {self.updates} updates (the actor is not finite):"
                " lower the learning rates or ddpg.reward_scale"
            )
        return score(self.policy(), config.scenario, config.physics, config.evaluation)

    def take_score(self, found: Score, log: Logger, bar: Progress) -> bool:
        """Keep the actor if it is the best so far; return True if the run may end."""
        candidate = self._judge(found, log)
        self.last = found
        bar.show(reach=found.reach_rate, falls=found.fall_rate, q=candidate.q_policy or 0.0)
        return self.meets_goal(found) and not candidate.overestimates

    def evaluate(self, log: Logger) -> Candidate:
        """Evaluate the actor, and keep it if it is the best so far; raises as `score_actor`."""
        return self._judge(self.score_actor(), log)

    def _judge(self, found: Score, log: Logger) -> Candidate:
        """Keep the actor if it is the best so far, and log its score."""
        self.evaluation_due = False
        policy = self.policy()
        overestimates = Candidate(policy, found, self.q_policy, kept=False).overestimates
        self.rejected += overestimates
        kept = self.keep(policy, found, acceptable=not overestimates)
        row = asdict(found) | {"q_policy": self.q_policy, "kept": kept}
        log.write("evaluation", self.updates, self.row(row))
        return Candidate(policy, found, self.q_policy, kept)

    def policy(self) -> Policy:
        """Return the current actor with its metadata."""
        kind = "td3+bc" if ddpg_of(self.config).bc_weight > 0 else "ddpg"
        return self.policy_of(kind, {"data": "recorded rides", "updates": self.updates})

    def state_dict(self) -> dict[str, Any]:
        """Return everything that future numbers depend on, except the memory."""
        own = {"refused": self.rejected, "q_policy": self.q_policy}
        return super().state_dict() | own | {"extra": {}}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`, to the bit; the caller fills the memory."""
        super().load_state_dict(state)
        self.rejected, self.q_policy = state["refused"], state["q_policy"]

    def load(self, path: Path) -> dict[str, Any]:
        """Resume from a checkpoint, to the bit.

        Returns:
            The `extra` that the caller gave to `save`.

        Raises:
            ValueError: if it cannot be read.
        """
        extra: dict[str, Any] = {}

        def take(state: dict[str, Any]) -> None:
            self.load_state_dict(state)
            extra.update(state["extra"])

        checkpoint.restore(path, take)
        return extra
