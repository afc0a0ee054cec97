"""Training runs of an experiment: plan them and make them."""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from bicycle_controller.config import loading
from bicycle_controller.config.run import RunConfig
from bicycle_controller.reproduce.experiment import Arm, Experiment, Length, Variant
from bicycle_controller.training import sweep
from bicycle_controller.training.run_folder import BusyError, RunFolder
from bicycle_sim.task.scenario import named

RECORD = ("record.episodes=true", "record.tracks_every=5", "tensorboard=false")


@dataclass(frozen=True)
class Run:
    """One training run of an experiment."""

    arm: Arm
    variant: Variant
    job: sweep.Job

    @property
    def succeeded(self) -> bool:
        """True if it is done and did not diverge."""
        done = json.loads(self.job.result.read_text()) if self.job.result.exists() else {}
        return done.get("status", "failed") != "failed"


def plan(
    experiment: Experiment,
    out: Path,
    mode: str,
    length: Length,
    only: Iterable[str] = (),
    device: str = "cpu",
    only_seeds: Iterable[int] = (),
) -> list[Run]:
    """Return every run, those of the same seed together; two experiments may share some.

    Args:
        experiment: whose runs are planned.
        out: folder of all runs.
        mode: `faithful` or `corrected`.
        length: seeds and episodes.
        only: names of arms; all by default.
        device: `cpu` or `cuda`.
        only_seeds: seeds to plan; 1 to `length.seeds` by default.

    Raises:
        ValueError: if a folder contains a run of another kind.
    """
    chosen = set(only) or {arm.name for arm in experiment.arms}
    seeds = tuple(only_seeds) or range(1, length.seeds + 1)
    return [
        _run(
            experiment,
            out / mode,
            [f"physics={mode}", f"device={device}"],
            length,
            arm,
            variant,
            seed,
        )
        for seed in seeds
        for variant in experiment.trained()
        for arm in experiment.arms
        if arm.name in chosen
    ]


def _run(
    experiment: Experiment,
    out: Path,
    changes: list[str],
    length: Length,
    arm: Arm,
    variant: Variant,
    seed: int,
) -> Run:
    steps = length.episodes * experiment.limit
    steps = max(1, min(steps, arm.most_steps or steps))
    changes = [*changes, f"seed={seed}", f"steps={steps}"]
    if arm.role != "best":
        changes.append(f"starts.max_steps={experiment.limit}")
    changes += [*RECORD, *experiment.training_changes(variant), *arm.set]
    config = loading.preset(arm.preset, changes)
    every = max(1, min(config.evaluation.every, total_updates(config) // length.evaluations))
    evaluation = dataclasses.replace(config.evaluation, every=every)
    config = dataclasses.replace(config, evaluation=evaluation)
    base = variant.scenario or experiment.scenario
    plain = config.scenario == named(base)
    where = base if plain else f"{base}-{experiment.name}-{variant.name}"
    # An annealed learning rate prevents a longer run, so it gets a folder of its own.
    annealed = config.learner.learning_rate_end < 1.0
    name = f"{arm.name}-{config.steps}" if annealed else arm.name
    folder = out / where / name / f"seed-{seed}"
    config = _lengthened(RunFolder(folder), config)
    return Run(arm, variant, sweep.Job(arm.preset, where, seed, config, folder))


def total_updates(config: RunConfig) -> int:
    """Return the number of updates of a complete run."""
    rounds = max(0, config.steps - config.warm_up) // config.bicycles
    return rounds // config.rounds_between * config.updates_due


def _lengthened(files: RunFolder, config: RunConfig) -> RunConfig:
    """Return the configuration to use: an existing run's, if only its length differs.

    A run that is longer than requested stays as it is.

    Raises:
        ValueError: if it is another run.
    """
    if not files.config.exists():
        return config
    old = loading.load(files.config)
    steps, evaluation = max(old.steps, config.steps), config.evaluation
    longer = dataclasses.replace(config, steps=steps)
    if dataclasses.replace(old, steps=steps, evaluation=evaluation) != longer:
        raise ValueError(
            f"{files.path} holds a run with other settings, perhaps of an older version: move it"
            " away, or give another --out"
        )
    return dataclasses.replace(old, steps=steps)


def there(run: Run) -> Run | None:
    """Return the run if it is done; else the longest finished one, if lengths have folders."""
    if run.job.result.exists():
        return run
    kind = run.job.folder.parent
    if run.job.config.learner.learning_rate_end == 1.0:
        return None
    others = kind.parent.glob(f"{run.arm.name}-*/{run.job.folder.name}/result.json")
    folders = [path.parent for path in others]
    if not folders:
        return None
    longest = max(folders, key=lambda folder: int(folder.parent.name.rpartition("-")[2]))
    return dataclasses.replace(run, job=dataclasses.replace(run.job, folder=longest))


def make(runs: list[Run], rides: int, address: str | None, parallel: int, progress: bool) -> int:
    """Make the unfinished runs: one after another, or several at once.

    A run that another process is making is left to it, so that two calls share the work.

    Args:
        runs: from `plan`.
        rides: number of rides of each final score.
        address: of a Ray cluster.
        parallel: runs at once on this machine.
        progress: True to draw bars on standard error.

    Returns:
        The number of the signal that stopped it, or 0.
    """
    jobs = list({run.job.folder: run.job for run in runs}.values())
    for job in jobs:
        _prepare(job)
    left = [job for job in jobs if not job.result.exists()]
    if address is not None or parallel > 1:
        sweep.sweep(left, rides, address, parallel, progress)
        return 0
    for number, job in enumerate(left, 1):
        if job.result.exists():  # made by another process in the meantime
            continue
        if progress:
            print(f"run {number} of {len(left)}: {job.folder}", file=sys.stderr)
        try:
            result, policy = sweep.run_job(job, rides, sys.argv, progress)
        except BusyError:
            continue
        sweep.store(job, result, policy)
        if result["status"] == "interrupted":
            return int(result["signal"])
    return 0


def _prepare(job: sweep.Job) -> None:
    """Allow a finished run to continue if a longer one is requested."""
    files = RunFolder(job.folder)
    if files.config.exists() and loading.load(files.config).steps < job.config.steps:
        files.resumed_config([f"steps={job.config.steps}"])
        job.result.unlink(missing_ok=True)
