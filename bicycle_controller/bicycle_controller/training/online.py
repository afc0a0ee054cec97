"""Training run: collect, update, evaluate, keep the best policy, save, repeat."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch

from bicycle_controller.agents.networks import policy_tensors
from bicycle_controller.config import loading
from bicycle_controller.config.run import RunConfig
from bicycle_controller.evaluation.score import Score, score
from bicycle_controller.policy.policy import Policy, PolicyInfo, save_policy
from bicycle_controller.training import checkpoint
from bicycle_controller.training.factory import make_agent, make_collector, make_memory
from bicycle_controller.training.logger import Logger, Progress
from bicycle_controller.training.run_folder import RunFolder, origin
from bicycle_controller.training.signals import InterruptError, StopRequest


@dataclass(frozen=True)
class Result:
    """Result of a run."""

    status: str
    """`finished` (all steps made), `reached` (`stop_at` was met) or `interrupted`."""
    signal: int
    """Number of the signal that interrupted it; 0 otherwise."""
    steps: int
    """Number of environment steps made."""
    updates: int
    best: Score | None
    """Score of `best.safetensors`."""
    wall_s: float
    """Wall time over all calls of the run, s."""
    cpu_s: float
    """Processor time over all calls of the run, s."""


def run(
    config: RunConfig,
    folder: Path,
    progress: bool = False,
    stop: Callable[[], bool] = lambda: False,
) -> Result:
    """Train in a new folder until the steps are made, the goal rate is met or `stop` is True.

    Args:
        config: the whole run.
        folder: created if missing; see `run_folder`.
        progress: True to draw a bar on standard error.
        stop: checked after every step of all bicycles.

    Raises:
        ValueError: if the folder contains a run already.
        BusyError: if another process trains there.
        RuntimeError: if training diverges.
    """
    files = RunFolder(folder)
    with files.held():
        files.create(config)
        return Trainer(config, files).train(progress, stop)


def resume(
    folder: Path,
    overrides: Iterable[loading.Override] = (),
    progress: bool = False,
    stop: Callable[[], bool] = lambda: False,
) -> Result:
    """Resume the run in `folder` from its last checkpoint, to the bit.

    Args:
        folder: of the run.
        overrides: changes, see `run_folder.RESUMABLE`.
        progress: whether to draw a bar on standard error.
        stop: asked after every step of all bicycles.

    Raises:
        ValueError: if there is no run, it cannot be read or a change is not allowed.
        BusyError: if another process trains there.
        RuntimeError: if training diverges.
    """
    files = RunFolder(folder)
    files.require()
    with files.held():
        trainer = Trainer(files.resumed_config(overrides), files)
        if files.checkpoint.exists():
            checkpoint.restore(files.checkpoint, trainer.load_state_dict)
        return trainer.train(progress, stop)


def usable_device(device: str) -> str:
    """Return `device`; without CUDA the CPU, with one line on standard error."""
    if device == "cuda" and not torch.cuda.is_available():
        print("no CUDA device was found: training on the CPU", file=sys.stderr)
        return "cpu"
    return device


class Trainer:
    """State of a run, and its loop.

    Attributes:
        updates: updates made, of the critic where there is one.
        best: score of the best policy so far.
    """

    def __init__(self, config: RunConfig, files: RunFolder) -> None:
        """Create everything from the configuration and its seed."""
        torch.set_num_threads(config.threads)
        device = usable_device(config.device)
        self.config, self.files = config, files
        self.replay = make_memory(config, device)
        self.collector = make_collector(config, self.replay, device)
        self.agent = make_agent(config, device)
        self.updates = 0
        self.best: Score | None = None
        self.evaluation_due = False
        self.log_bytes = 0
        self.spent = (0.0, 0.0)
        self._started = (time.monotonic(), time.process_time())
        self._origin = origin()

    def train(self, progress: bool, stop: Callable[[], bool]) -> Result:
        """Train until all steps are made, the goal rate is met or `stop` is requested."""
        steps = self.collector.steps
        self._started = (time.monotonic(), time.process_time())
        saved = time.monotonic()
        status = "finished"
        log = Logger(self.files.path, self.log_bytes, steps, self.config.tensorboard)
        bar = Progress(self.config.steps, steps, progress)
        with log, bar, StopRequest() as interrupt:
            while self.evaluation_due or self.collector.steps < self.config.steps:
                if not self.evaluation_due:
                    self._advance(log, bar)
                if (
                    self.evaluation_due
                    and not interrupt.signal
                    and self._evaluate(log, bar, interrupt)
                ):
                    status = "reached"
                    break
                if interrupt.signal or stop():
                    status = "interrupted"
                    break
                if time.monotonic() - saved >= self.config.save_every:
                    self.save(log)
                    saved = time.monotonic()
            self.save(log)
        save_policy(self.policy(), self.files.last)
        wall, cpu = self._time()
        steps = self.collector.steps
        return Result(status, interrupt.signal, steps, self.updates, self.best, wall, cpu)

    def _advance(self, log: Logger, bar: Progress) -> None:
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
        every = config.evaluation.every
        self.evaluation_due = self.updates // every > before // every
        if self.updates // config.log_every > before // config.log_every:
            row = self.collector.metrics() | self.agent.metrics()
            log.write("train", self.collector.steps, self._row(row))
            bar.show(updates=self.updates, ret=row["return"], goals=row["goal_rate"])

    def _evaluate(self, log: Logger, bar: Progress, interrupt: StopRequest) -> bool:
        """Score the actor and keep it if it is the best; return True if the run may end."""
        config, policy = self.config, self.policy()
        try:
            with interrupt.at_once():
                found = score(policy, config.scenario, config.physics, config.evaluation)
        except InterruptError:
            return False
        self.evaluation_due = False
        if self.best is None or found.rank > self.best.rank:
            self.best = found
            save_policy(policy, self.files.best)
        save_policy(policy, self.files.last)
        log.write("evaluation", self.collector.steps, self._row(asdict(found)))
        bar.show(reach=found.reach_rate, falls=found.fall_rate)
        limits = config.evaluation
        met = found.reach_rate >= limits.stop_at and found.fall_rate <= limits.stop_falls
        return limits.stop_at > 0 and met

    def _row(self, values: dict[str, Any]) -> dict[str, Any]:
        wall, cpu = self._time()
        return {"updates": self.updates} | values | {"wall_s": wall, "cpu_s": cpu}

    def _time(self) -> tuple[float, float]:
        """Return wall and processor time in s, summed over all calls of the run."""
        wall = self.spent[0] + time.monotonic() - self._started[0]
        return wall, self.spent[1] + time.process_time() - self._started[1]

    def policy(self) -> Policy:
        """Return the current actor with its metadata."""
        config = self.config
        about = {"algorithm": config.algorithm, "preset": config.preset, "seed": config.seed}
        about |= {"steps": self.collector.steps, "updates": self.updates}
        about["backend"] = self.agent.backend
        name = f"{config.preset or config.algorithm}-{config.scenario.name}-{config.seed}"
        info = PolicyInfo(
            name=re.sub(r"[^A-Za-z0-9._-]", "-", name)[:64],
            scenario=config.scenario,
            plant=config.physics,
            observation_scale=config.learner.observation_scale,
            action_limits=tuple(config.scenario.action_limits.tolist()),
            trained=about | {key: self._origin[key] for key in ("command", "commit", "version")},
        )
        return Policy(info, policy_tensors(self.agent.deployed))

    def save(self, log: Logger) -> None:
        """Write the checkpoint."""
        self.log_bytes = log.sync()
        self.collector.flush(self.files.path)
        checkpoint.save(self.files.checkpoint, self.state_dict())

    def state_dict(self) -> dict[str, Any]:
        """Return everything that future numbers depend on."""
        return {
            "agent": self.agent.state_dict(),
            "collector": self.collector.state_dict(),
            "replay": self.replay.state_dict(),
            "updates": self.updates,
            "evaluation_due": self.evaluation_due,
            "best": None if self.best is None else asdict(self.best),
            "log_bytes": self.log_bytes,
            "spent": list(self._time()),
            "origin": self._origin,
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
        self.agent.load_state_dict(state["agent"])
        self.collector.load_state_dict(state["collector"])
        self.replay.load_state_dict(state["replay"])
        self.updates, self.evaluation_due = state["updates"], state["evaluation_due"]
        self.best = None if state["best"] is None else Score(**state["best"])
        self.log_bytes = state["log_bytes"]
        self.spent = (state["spent"][0], state["spent"][1])
