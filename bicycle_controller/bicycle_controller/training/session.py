"""Common part of online and offline runs: agent, best policy, log, times, checkpoint."""

from __future__ import annotations

import json
import re
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import torch

from bicycle_common.observation import ACTION_FIELDS, OBSERVATION_FIELDS
from bicycle_common.signals import StopRequest
from bicycle_controller.agents.networks import policy_tensors
from bicycle_controller.config.algorithms import DdpgConfig
from bicycle_controller.config.run import RunConfig
from bicycle_controller.evaluation.score import Score
from bicycle_controller.policy.policy import Policy, PolicyInfo, save_policy
from bicycle_controller.policy.trained_for import TOO
from bicycle_controller.training import checkpoint
from bicycle_controller.training.factory import make_agent
from bicycle_controller.training.logger import Logger, Progress
from bicycle_controller.training.run_folder import RunFolder, origin


def usable_device(device: str) -> str:
    """Return `device`; if it is cuda and there is none, say so and return cpu."""
    if device == "cuda" and not torch.cuda.is_available():
        print("no CUDA device was found: training on the CPU", file=sys.stderr)
        return "cpu"
    return device


def _inputs(config: RunConfig) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """Return the names of the actor's inputs, and the divisor of each in SI units."""
    learner = config.learner
    if not isinstance(learner, DdpgConfig):
        return OBSERVATION_FIELDS, learner.observation_scale
    limits = dict(zip(ACTION_FIELDS, config.scenario.action_limits.tolist(), strict=True))
    fields = (name.partition("[")[0] for name in learner.inputs)
    pairs = zip(fields, learner.actor_scale, strict=True)
    return learner.inputs, tuple(limits.get(name) or scale for name, scale in pairs)


class TrainingSession(ABC):
    """State and loop of a run; subclasses define the source of its transitions.

    Attributes:
        updates: updates made, of the critic if there is one.
        best: score of the best policy so far.
        evaluation_due: True if the actor must be scored next.
        log_bytes: length of the log at the last checkpoint.
    """

    def __init__(self, config: RunConfig, files: RunFolder, device: str) -> None:
        """Initialise the networks on `device`."""
        torch.set_num_threads(config.threads)
        self.config, self.files = config, files
        self.agent = make_agent(config, device)
        self.updates = 0
        self.best: Score | None = None
        self.evaluation_due = False
        self.log_bytes = 0
        self._spent = (0.0, 0.0)
        self._origin = origin()
        self.start_clock()

    @property
    @abstractmethod
    def finished(self) -> bool:
        """True if the budget is spent; a score may still be due."""

    @abstractmethod
    def step(self, log: Logger, bar: Progress) -> None:
        """Make the next steps and updates; set `evaluation_due`."""

    @abstractmethod
    def try_actor(self, log: Logger, bar: Progress, interrupt: StopRequest) -> bool:
        """Score the actor and keep it if it is the best; return True if the run may end."""

    def work(self, log: Logger, bar: Progress, stop: Callable[[], bool]) -> tuple[str, int]:
        """Work until the budget is spent, the goal rate is met or a stop is requested.

        Returns:
            `finished`, `reached` or `interrupted`; the number of the signal received, or 0.
        """
        status, saved = "finished", time.monotonic()
        with log, bar, StopRequest() as interrupt:
            while self.evaluation_due or not self.finished:
                if not self.evaluation_due:
                    self.step(log, bar)
                scored = self.evaluation_due and not interrupt.signal
                if scored and self.try_actor(log, bar, interrupt):
                    status = "reached"
                    break
                if interrupt.signal or stop():
                    status = "interrupted"
                    break
                if time.monotonic() - saved >= self.config.save_every:
                    self.save(log)
                    saved = time.monotonic()
            self.save(log)
        return status, interrupt.signal

    def crossed(self, every: int, before: int) -> bool:
        """Return True if the updates since `before` passed a multiple of `every`."""
        return self.updates // every > before // every

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
            trained=trained | {key: self._origin[key] for key in ("command", "commit", "version")},
        )
        return Policy(info, policy_tensors(self.agent.deployed))

    def start_clock(self) -> None:
        """Start to count time."""
        self._started = (time.monotonic(), time.process_time())

    def time(self) -> tuple[float, float]:
        """Return wall and processor time in s, summed over all calls of the run."""
        wall = self._spent[0] + time.monotonic() - self._started[0]
        return wall, self._spent[1] + time.process_time() - self._started[1]

    def row(self, values: dict[str, Any]) -> dict[str, Any]:
        """Return a row of the log: `values` between the updates and the times."""
        wall, cpu = self.time()
        return {"updates": self.updates} | values | {"wall_s": wall, "cpu_s": cpu}

    def save(self, log: Logger, **extra: Any) -> None:
        """Write the checkpoint. `extra` is the caller's own state."""
        self.log_bytes = log.sync()
        checkpoint.save(self.files.checkpoint, self.state_dict() | extra)

    def state_dict(self) -> dict[str, Any]:
        """Return everything in this class that future numbers depend on."""
        return {
            "agent": self.agent.state_dict(),
            "updates": self.updates,
            "evaluation_due": self.evaluation_due,
            "best": None if self.best is None else asdict(self.best),
            "log_bytes": self.log_bytes,
            "spent": list(self.time()),
            "origin": self._origin,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`, to the bit."""
        self.agent.load_state_dict(state["agent"])
        self.updates, self.evaluation_due = state["updates"], state["evaluation_due"]
        self.best = None if state["best"] is None else Score(**state["best"])
        self.log_bytes = state["log_bytes"]
        self._spent = (state["spent"][0], state["spent"][1])
