"""One training session: the loop of every run, with its scores, log, times and checkpoints."""

from __future__ import annotations

import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import torch

from bicycle_common.signals import InterruptError, StopRequest
from bicycle_controller.training import checkpoint
from bicycle_controller.training.logger import Logger, Progress, Shown
from bicycle_controller.training.run_folder import RunFolder, origin

Scored = TypeVar("Scored")
"""Score of a candidate, a dataclass."""


def usable_device(device: str) -> str:
    """Return `device`; if it is cuda and there is none, say so and return cpu."""
    if device == "cuda" and not torch.cuda.is_available():
        print("no CUDA device was found: training on the CPU", file=sys.stderr)
        return "cpu"
    return device


@dataclass(frozen=True)
class Result(Generic[Scored]):
    """Result of a run that makes its own steps."""

    status: str
    """`finished` (all steps made), `reached` (`stop_at` was met) or `interrupted`."""
    signal: int
    """Number of the signal that interrupted it; 0 otherwise."""
    steps: int
    """Number of environment steps made."""
    updates: int
    best: Scored | None
    """Score of the best candidate; None before the first score."""
    wall_s: float
    """Wall time over all calls of the run, s."""
    cpu_s: float
    """Processor time over all calls of the run, s."""


class SessionSettings(Protocol):
    """Part of a configuration that a session reads."""

    @property
    def threads(self) -> int:
        """Threads of torch."""

    @property
    def save_every(self) -> float:
        """Time between two checkpoints, s."""

    @property
    def tensorboard(self) -> bool:
        """True to write TensorBoard files, if it is installed."""


class TrainingSession(ABC, Generic[Scored]):
    """State and loop of a run; subclasses define what a step is, and what a score.

    Attributes:
        updates: updates made, of the critic if there is one.
        best: score of the best candidate so far.
        evaluation_due: True if the actor must be scored next.
        log_bytes: length of the log at the last checkpoint.
    """

    unit: ClassVar[str] = "step"
    """Name of what `done` counts."""
    score_type: ClassVar[type[Any]]
    """Class of a score."""

    def __init__(self, settings: SessionSettings, files: RunFolder) -> None:
        """Begin with nothing done."""
        torch.set_num_threads(settings.threads)
        self._settings, self.files = settings, files
        self.updates = 0
        self.best: Scored | None = None
        self.evaluation_due = False
        self.log_bytes = 0
        self._spent = (0.0, 0.0)
        self._origin = origin()
        self.start_clock()

    @property
    @abstractmethod
    def done(self) -> int:
        """Number of steps, or of what `unit` names, so far."""

    @property
    @abstractmethod
    def budget(self) -> int:
        """Number of them at which the run ends."""

    @property
    def finished(self) -> bool:
        """True if the budget is spent; a score may still be due."""
        return self.done >= self.budget

    @abstractmethod
    def step(self, log: Logger, bar: Progress) -> None:
        """Make the next steps and updates; set `evaluation_due`."""

    @abstractmethod
    def score_actor(self) -> Scored:
        """Return the actor's score; changes nothing, because a signal ends it at once."""

    @abstractmethod
    def take_score(self, found: Scored, log: Logger, bar: Progress) -> bool:
        """Log the actor's score, keep it if it is the best; return True if the run may end."""

    def train(self, progress: Shown, stop: Callable[[], bool]) -> Result[Scored]:
        """Train until the budget is spent, the goal rate is met or a stop is requested."""
        status, signal = self.work(progress, stop)
        self.leave_actor()
        return Result(status, signal, self.done, self.updates, self.best, *self.time())

    def leave_actor(self) -> None:
        """Write the actor as it is at the end of `train`; nothing by default."""

    def work(self, progress: Shown, stop: Callable[[], bool]) -> tuple[str, int]:
        """Work until the budget is spent, the goal rate is met or a stop is requested.

        Returns:
            `finished`, `reached` or `interrupted`; the number of the signal received, or 0.
        """
        self.start_clock()
        status, saved = "finished", time.monotonic()
        with StopRequest() as interrupt, self._log() as log, self._bar(progress) as bar:
            while self.evaluation_due or not self.finished:
                if not self.evaluation_due:
                    self.step(log, bar)
                scored = self.evaluation_due and not interrupt.signal
                if scored and self._try_actor(log, bar, interrupt):
                    status = "reached"
                    break
                if interrupt.signal or stop():
                    status = "interrupted"
                    break
                if time.monotonic() - saved >= self._settings.save_every:
                    self.save(log)
                    saved = time.monotonic()
            self.save(log)
        return status, interrupt.signal

    def _log(self) -> Logger:
        return Logger(self.files.path, self.log_bytes, self.done, self._settings.tensorboard)

    def _bar(self, progress: Shown) -> Progress:
        return Progress(self.budget, self.done, progress, self.unit)

    def _try_actor(self, log: Logger, bar: Progress, interrupt: StopRequest) -> bool:
        """Score the actor unless a signal comes, after which the score is still due."""
        try:
            with interrupt.at_once():
                found = self.score_actor()
        except InterruptError:
            return False
        self.evaluation_due = False
        return self.take_score(found, log, bar)

    @property
    def begun(self) -> dict[str, Any]:
        """Command, commit, version, time and processor with which the run began."""
        return dict(self._origin)

    @property
    def made_by(self) -> dict[str, Any]:
        """Command, commit and version that began the run."""
        return {key: self._origin[key] for key in ("command", "commit", "version")}

    def crossed(self, every: int, before: int) -> bool:
        """Return True if the updates since `before` passed a multiple of `every`."""
        return self.updates // every > before // every

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

    def restore(self) -> None:
        """Go on from the folder's checkpoint, to the bit; from the beginning if there is none.

        Raises:
            ValueError: if it cannot be read.
        """
        if self.files.checkpoint.exists():
            checkpoint.restore(self.files.checkpoint, self.load_state_dict)

    def state_dict(self) -> dict[str, Any]:
        """Return everything in this class that future numbers depend on."""
        return {
            "updates": self.updates,
            "evaluation_due": self.evaluation_due,
            "best": None if self.best is None else asdict(self.best),  # type: ignore[call-overload]
            "log_bytes": self.log_bytes,
            "spent": list(self.time()),
            "origin": self._origin,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`, to the bit."""
        self.updates, self.evaluation_due = state["updates"], state["evaluation_due"]
        self.best = None if state["best"] is None else self.score_type(**state["best"])
        self.log_bytes = state["log_bytes"]
        self._spent = (state["spent"][0], state["spent"][1])
