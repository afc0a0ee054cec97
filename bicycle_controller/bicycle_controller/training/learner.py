"""Updates from a replay memory that others fill: with recorded rides, or live ones.

Candidates are evaluated as in `online`: they ride in the vectorised simulator from fixed starts,
and the best is kept, judged by rides and never by losses.
"""

from __future__ import annotations

import re
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch

from bicycle_controller.agents.networks import policy_tensors
from bicycle_controller.config.algorithms import DdpgConfig
from bicycle_controller.config.run import RunConfig, ShapingConfig
from bicycle_controller.data.replay_buffer import ReplayBuffer
from bicycle_controller.evaluation.score import Score, score
from bicycle_controller.policy.policy import Policy, PolicyInfo, save_policy
from bicycle_controller.training import checkpoint
from bicycle_controller.training.factory import make_agent
from bicycle_controller.training.logger import Logger
from bicycle_controller.training.online import usable_device
from bicycle_controller.training.run_folder import RunFolder, origin

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


class Learner:
    """An agent with its best policy, its log and its checkpoint.

    Attributes:
        updates: critic updates made.
        best: score of the best policy so far.
        rejected: candidates rejected because their critic overestimates.
        evaluation_due: True if the next candidate must be scored.
    """

    def __init__(self, config: RunConfig, files: RunFolder, replay: ReplayBuffer) -> None:
        """Initialise the networks; `replay` may be filled later."""
        torch.set_num_threads(config.threads)
        self.config, self.files, self.replay = config, files, replay
        self.agent = make_agent(config, usable_device(config.device))
        self.updates = self.rejected = 0
        self.best: Score | None = None
        self.evaluation_due = False
        self.q_policy: float | None = None
        self.log_bytes = 0
        self.spent = (0.0, 0.0)
        self._started = (time.monotonic(), time.process_time())
        self._origin = origin()

    def advance(self, log: Logger, count: int = CHUNK, progress: float = 0.0) -> None:
        """Make `count` updates; `progress` is the finished share of the run."""
        config, before = self.config, self.updates
        self.agent.anneal(progress)
        self.agent.update(self.replay, count)
        self.updates += count
        every = config.evaluation.every
        self.evaluation_due = self.updates // every > before // every
        if self.updates // config.log_every > before // config.log_every or self.evaluation_due:
            row = self.agent.metrics()
            self.q_policy = row.get("q_policy", self.q_policy)
            log.write("learn", self.updates, self._row(row))

    def evaluate(self, log: Logger) -> Candidate:
        """Evaluate the actor from the fixed starts, and keep it if it is the best so far.

        Raises:
            RuntimeError: if learning has diverged.
        """
        config = self.config
        if not all(torch.isfinite(item).all() for item in self.agent.actor.parameters()):
            raise RuntimeError(
                f"learning has diverged after {self.updates} updates (the actor is not finite):"
                " lower the learning rates or ddpg.reward_scale"
            )
        policy = self.policy()
        found = score(policy, config.scenario, config.physics, config.evaluation)
        self.evaluation_due = False
        better = self.best is None or found.rank > self.best.rank
        candidate = Candidate(policy, found, self.q_policy, better)
        if candidate.overestimates:
            self.rejected += 1
            candidate = Candidate(policy, found, self.q_policy, kept=False)
        if candidate.kept:
            self.best = found
            save_policy(policy, self.files.best)
        save_policy(policy, self.files.last)
        row = asdict(found) | {"q_policy": self.q_policy, "kept": candidate.kept}
        log.write("evaluation", self.updates, self._row(row))
        return candidate

    def policy(self) -> Policy:
        """Return the current actor with its metadata."""
        config = self.config
        ddpg = ddpg_of(config)
        kind = "td3+bc" if ddpg.bc_weight > 0 else "ddpg"
        about = {"algorithm": kind, "preset": config.preset, "seed": config.seed}
        about |= {"data": "recorded rides", "updates": self.updates}
        name = f"{config.preset or kind}-{config.scenario.name}-{config.seed}"
        info = PolicyInfo(
            name=re.sub(r"[^A-Za-z0-9._-]", "-", name)[:64],
            scenario=config.scenario,
            plant=config.physics,
            observation_scale=ddpg.observation_scale,
            action_limits=tuple(config.scenario.action_limits.tolist()),
            trained=about | {key: self._origin[key] for key in ("command", "commit", "version")},
        )
        return Policy(info, policy_tensors(self.agent.deployed))

    def time(self) -> tuple[float, float]:
        """Return wall and processor time in s, summed over all calls of the run."""
        wall = self.spent[0] + time.monotonic() - self._started[0]
        return wall, self.spent[1] + time.process_time() - self._started[1]

    def _row(self, values: dict[str, Any]) -> dict[str, Any]:
        wall, cpu = self.time()
        return {"updates": self.updates} | values | {"wall_s": wall, "cpu_s": cpu}

    def save(self, log: Logger, extra: dict[str, Any]) -> None:
        """Write the checkpoint without the memory. `extra` is the caller's own state."""
        self.log_bytes = log.sync()
        checkpoint.save(self.files.checkpoint, self.state_dict() | {"extra": extra})

    def state_dict(self) -> dict[str, Any]:
        """Return everything that future numbers depend on, except the memory."""
        return {
            "agent": self.agent.state_dict(),
            "updates": self.updates,
            "refused": self.rejected,
            "evaluation_due": self.evaluation_due,
            "q_policy": self.q_policy,
            "best": None if self.best is None else asdict(self.best),
            "log_bytes": self.log_bytes,
            "spent": list(self.time()),
            "origin": self._origin,
        }

    def load(self, path: Path) -> dict[str, Any]:
        """Resume from a checkpoint, to the bit.

        Returns:
            The `extra` that the caller gave to `save`.

        Raises:
            ValueError: if it cannot be read.
        """
        extra: dict[str, Any] = {}

        def take(state: dict[str, Any]) -> None:
            self._load_state_dict(state)
            extra.update(state["extra"])

        checkpoint.restore(path, take)
        return extra

    def _load_state_dict(self, state: dict[str, Any]) -> None:
        self.agent.load_state_dict(state["agent"])
        self.updates, self.rejected = state["updates"], state["refused"]
        self.evaluation_due, self.q_policy = state["evaluation_due"], state["q_policy"]
        self.best = None if state["best"] is None else Score(**state["best"])
        self.log_bytes = state["log_bytes"]
        self.spent = (state["spent"][0], state["spent"][1])
