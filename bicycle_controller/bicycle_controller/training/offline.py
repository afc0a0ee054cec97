"""Learning from recorded rides alone: a fixed budget of updates; the best actor is kept."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bicycle_controller.config.run import RunConfig
from bicycle_controller.data import dataset
from bicycle_controller.data.dataset import Dataset
from bicycle_controller.data.dataset_report import report
from bicycle_controller.data.replay_buffer import ReplayBuffer
from bicycle_controller.evaluation.score import Score
from bicycle_controller.policy.policy import write_atomically
from bicycle_controller.training.learner import Learner, ddpg_of
from bicycle_controller.training.logger import Shown
from bicycle_controller.training.run_folder import RunFolder
from bicycle_controller.training.session import usable_device

DATA = "dataset.json"
"""File in the run's folder: the bags, their content, and a digest."""


@dataclass(frozen=True)
class Learned:
    """Result of a run."""

    status: str
    """`finished` (all updates made), `reached` (`stop_at` was met) or `interrupted`."""
    signal: int
    """Number of the signal that interrupted it; 0 otherwise."""
    updates: int
    transitions: int
    best: Score | None
    """Score of `best.safetensors`; None if no candidate was kept."""
    last: Score | None
    """Score of the last candidate, kept or not."""
    refused: int
    """Candidates rejected because the mean Q of their actions was above 0."""
    q_policy: float | None
    """Mean Q of the last candidate's actions, in scaled reward."""
    wall_s: float
    """Wall time over all calls of the run, s."""
    cpu_s: float
    """Processor time over all calls of the run, s."""


def run(
    config: RunConfig,
    data: Dataset,
    folder: Path,
    progress: Shown = False,
    stop: Callable[[], bool] = lambda: False,
) -> Learned:
    """Learn in a new folder from checked data.

    Args:
        config: the run; its scenario and bicycle become those of the data.
        data: see `dataset.check`.
        folder: created if missing; see `run_folder`.
        progress: True to draw a bar on standard error, `lines` to print lines there.
        stop: checked between updates.

    Raises:
        ValueError: if the folder contains a run already, or the configuration does not suit bags.
        RuntimeError: if learning diverges.
    """
    return _learn(begin(config, data, folder), progress, stop)


def begin(config: RunConfig, data: Dataset, folder: Path) -> Learner:
    """Create a run's folder and its learner, before the first update; arguments as in `run`."""
    config = replace(config, scenario=data.scenario, physics=data.plant)
    rows = dataset.memory_rows(data, ddpg_of(config))
    files = RunFolder(folder)
    files.create(config)
    about = report(data) | {"digest": _digest(rows)}
    write_atomically(folder / DATA, json.dumps(about, indent=2).encode() + b"\n")
    return Learner(config, files, _memory(config, rows))


def resume(
    folder: Path,
    progress: Shown = False,
    stop: Callable[[], bool] = lambda: False,
) -> Learned:
    """Resume the run in `folder` from its last checkpoint, to the bit.

    Raises:
        ValueError: if there is no such run, it cannot be read, or its bags have changed.
        RuntimeError: if learning diverges.
    """
    return _learn(reopen(folder), progress, stop)


def reopen(folder: Path) -> Learner:
    """Return the learner of the run in `folder` from its last checkpoint; see `resume`."""
    files = RunFolder(folder)
    if not (folder / DATA).exists():
        raise ValueError(f"{folder} holds no run of 'bicycle learn' to resume: leave out --resume")
    config = files.resumed_config([])
    about: dict[str, Any] = json.loads((folder / DATA).read_text())
    paths = list(dict.fromkeys(bag["path"] for bag in about["bags"]))
    data = dataset.load(paths, config.scenario)
    rows = dataset.memory_rows(data, ddpg_of(config))
    if _digest(rows) != about["digest"]:
        raise ValueError("the bags have changed since the run began: choose another --out")
    learner = Learner(config, files, _memory(config, rows))
    learner.restore()
    return learner


def _digest(rows: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(rows).tobytes()).hexdigest()


def _memory(config: RunConfig, rows: np.ndarray) -> ReplayBuffer:
    """Create a replay memory that holds exactly `rows`."""
    actions = int((config.scenario.action_limits > 0).sum())
    memory = ReplayBuffer(len(rows), actions, usable_device(config.device))
    memory.add(rows)
    return memory


def _learn(learner: Learner, progress: Shown, stop: Callable[[], bool]) -> Learned:
    """Learn until the budget is spent, the goal rate is met or `stop` is requested."""
    status, signal = learner.work(progress, stop)
    return Learned(
        status,
        signal,
        learner.updates,
        learner.replay.size,
        learner.best,
        learner.last,
        learner.rejected,
        learner.q_policy,
        *learner.time(),
    )
