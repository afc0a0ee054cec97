"""Training run: collect, update, evaluate, keep the best policy, save, repeat."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from bicycle_controller.config import loading
from bicycle_controller.config.run import RunConfig
from bicycle_controller.evaluation.score import Score, hardships, score
from bicycle_controller.policy.policy import Policy, save_policy
from bicycle_controller.training.agent_session import AgentSession
from bicycle_controller.training.factory import make_collector, make_memory
from bicycle_controller.training.logger import Logger, Progress, Shown
from bicycle_controller.training.run_folder import RunFolder
from bicycle_controller.training.session import Result, TrainingSession, usable_device


def run(
    config: RunConfig,
    folder: Path,
    progress: Shown = False,
    stop: Callable[[], bool] = lambda: False,
    kind: Callable[[RunConfig, RunFolder], TrainingSession[Score]] | None = None,
) -> Result[Score]:
    """Train in a new folder until the steps are made, the goal rate is met or `stop` is True.

    Args:
        config: the whole run.
        folder: created if missing; see `run_folder`.
        progress: True to draw a bar on standard error, `lines` to print lines there.
        stop: checked after every step of all bicycles.
        kind: what trains; `Trainer` by default.

    Raises:
        ValueError: if the folder contains a run already.
        BusyError: if another process trains there.
        RuntimeError: if training diverges.
    """
    files = RunFolder(folder)
    with files.held():
        files.create(config)
        return (kind or Trainer)(config, files).train(progress, stop)


def resume(
    folder: Path,
    overrides: Iterable[loading.Override] = (),
    progress: Shown = False,
    stop: Callable[[], bool] = lambda: False,
    kind: Callable[[RunConfig, RunFolder], TrainingSession[Score]] | None = None,
) -> Result[Score]:
    """Resume the run in `folder` from its last checkpoint, to the bit.

    Args:
        folder: the run's folder.
        overrides: changes, see `run_folder.RESUMABLE`.
        progress: True to draw a bar on standard error, `lines` to print lines there.
        stop: checked after every step of all bicycles.
        kind: as in `run`.

    Raises:
        ValueError: if there is no run, it cannot be read or a change is not allowed.
        BusyError: if another process trains there.
        RuntimeError: if training diverges.
    """
    files = RunFolder(folder)
    files.require()
    with files.held():
        session = (kind or Trainer)(files.resumed_config(overrides), files)
        session.restore()
        return session.train(progress, stop)


class Trainer(AgentSession):
    """A run that collects its transitions in simulation."""

    def __init__(self, config: RunConfig, files: RunFolder) -> None:
        """Build everything from the configuration and its seed."""
        device = usable_device(config.device)
        self.replay = make_memory(config, device)
        self.collector = make_collector(config, self.replay, device)
        super().__init__(config, files, device)

    def leave_actor(self) -> None:
        """Write it as the last policy."""
        save_policy(self.policy(), self.files.last)

    @property
    def done(self) -> int:
        """Environment steps made."""
        return self.collector.steps

    @property
    def budget(self) -> int:
        """Environment steps to be made."""
        return self.config.steps

    def step(self, log: Logger, bar: Progress) -> None:
        """Step all bicycles once and make the updates that are due."""
        config, before = self.config, self.updates
        self.collector.step(self.agent)
        bar.advance(config.bicycles)
        warm = self.collector.steps >= config.warm_up
        if not warm or self.collector.rounds % config.rounds_between:
            return
        self.agent.anneal(self.collector.steps / config.steps)
        self.agent.update(self.replay, config.updates_due)
        self.updates += config.updates_due
        self.evaluation_due = self.crossed(config.evaluation.every, before)
        if self.crossed(config.log_every, before):
            row = self.collector.metrics() | self.agent.metrics()
            log.write("train", self.collector.steps, self.row(row))
            bar.show(updates=self.updates, ret=row["return"], goals=row["goal_rate"])

    def score_actor(self) -> Score:
        """Return the score of the actor's rides from the fixed starts."""
        config = self.config
        hard = hardships(config.physics, config.physics_too, config.starts)
        return score(self.policy(), config.scenario, config.physics, config.evaluation, hard)

    def take_score(self, found: Score, log: Logger, bar: Progress) -> bool:
        """Keep the actor if it is the best so far; return True if the run may end."""
        self.keep(self.policy(), found)
        log.write("evaluation", self.collector.steps, self.row(asdict(found)))
        bar.show(reach=found.reach_rate, falls=found.fall_rate)
        return self.meets_goal(found)

    def policy(self) -> Policy:
        """Return the current actor with its metadata."""
        about = {"steps": self.collector.steps, "updates": self.updates}
        return self.policy_of(self.config.algorithm, about | {"backend": self.agent.backend})

    def save(self, log: Logger, **extra: Any) -> None:
        """Write the checkpoint and the rides that belong to it."""
        self.collector.flush(self.files.path)
        super().save(log, **extra)

    def state_dict(self) -> dict[str, Any]:
        """Return everything that future numbers depend on."""
        return super().state_dict() | {
            "collector": self.collector.state_dict(),
            "replay": self.replay.state_dict(),
            "backend": self.agent.backend,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`: to the bit, if the backend is the same."""
        if state["backend"] != self.agent.backend:
            print(
                f"{state['backend']} began this run and {self.agent.backend} goes on with it:"
                " its numbers will differ by rounding",
                file=sys.stderr,
            )
        super().load_state_dict(state)
        self.collector.load_state_dict(state["collector"])
        self.replay.load_state_dict(state["replay"])
