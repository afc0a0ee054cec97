"""Run an experiment in one mode of the physics: train, ride, write the data, draw."""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bicycle_common.progress import ProgressBar
from bicycle_controller.policy.policy import write_atomically
from bicycle_controller.reproduce import evaluate_experiments, logs, summary, training
from bicycle_controller.reproduce.evaluate_experiments import Ridden
from bicycle_controller.reproduce.experiment import Experiment, Length, build, limited
from bicycle_controller.reproduce.kept import Kept
from bicycle_controller.reproduce.tables import Row, write_table
from bicycle_controller.training.run_folder import origin
from bicycle_sim.plants import registry

RUNS = "runs"
"""Folder of the training runs, beside the figures' folders."""


@dataclass(frozen=True)
class ReproduceOptions:
    """Command-line options of a reproduction."""

    out: Path
    short: bool = False
    arms: tuple[str, ...] = ()
    """Names of the arms to train; all by default."""
    only_seeds: tuple[int, ...] = ()
    """Seeds to train; all by default."""
    train: bool = True
    """True to train; False to ride only what is trained already."""
    address: str | None = None
    parallel: int = 1
    device: str = "cpu"
    progress: bool = False


def reproduce(experiment: Experiment, mode: str, length: Length, options: ReproduceOptions) -> int:
    """Create the experiment's data and picture in `OUT/NAME/MODE`.

    Returns:
        The number of the signal that stopped it, or 0.

    Raises:
        ValueError: if the folder contains a run of another kind.
    """
    out, progress = options.out, options.progress
    experiment = limited(experiment, length)
    about = origin() | {"figure": experiment.name, "physics": mode, "short": options.short}
    if options.train and length.episodes:
        runs = training.plan(
            experiment,
            out / RUNS,
            mode,
            length,
            options.arms,
            options.device,
            options.only_seeds,
        )
        signal = training.make(runs, length.rides, options.address, options.parallel, progress)
        if signal:
            return signal
    started = (time.monotonic(), time.process_time())
    planned = training.plan(experiment, out / RUNS, mode, length, device=options.device)
    done = [run for run in map(training.there, planned) if run is not None]
    good = [run for run in done if run.succeeded]
    folder = out / experiment.name / mode
    own = [(run.arm.name, run.variant.name, run.job.seed) for run in done]
    kept = Kept(folder, experiment, own, length.rides)
    _write_training(folder, experiment, good, kept)
    ridden = list(evaluate_experiments.riders(experiment, mode, good))
    about["policies"] = {item.name: item.controller.policy_id for item in ridden if not item.seed}
    _write_rides(folder, experiment, mode, length, ridden, kept, progress)
    wall, cpu = time.monotonic() - started[0], time.process_time() - started[1]
    about |= {"seeds": list(range(1, length.seeds + 1)), "ride_seed": evaluate_experiments.SEED}
    about |= {"rides": length.rides, "wall_s": round(wall, 1), "cpu_s": round(cpu, 1)}
    trained = [*map(logs.provenance, done), *kept.training]
    about["training"] = kept.ordered(trained)
    about["experiment"] = asdict(experiment)
    _write_json(folder / "run.json", about)
    _finish(experiment, folder)
    return 0


def redraw(experiment: Experiment, mode: str, out: Path) -> bool:
    """Recreate summary and picture from the data; return True if there is any."""
    folder = out / experiment.name / mode
    if not (folder / "run.json").exists():
        return False
    run = json.loads((folder / "run.json").read_text())
    _finish(build(experiment.name, run["experiment"]), folder)
    return True


def _finish(experiment: Experiment, folder: Path) -> None:
    """Write summary and picture from the raw data."""
    _write_json(folder / "summary.json", summary.summarise(folder))
    from bicycle_controller.reproduce.pictures import draw

    draw(experiment, folder)


def _write_training(
    folder: Path, experiment: Experiment, runs: list[training.Run], kept: Kept
) -> None:
    """Write the results of the training episodes, and the tracks of some."""
    limit = experiment.limit
    for name, read in ((summary.CURVES, logs.curves), (summary.EVALUATIONS, logs.evaluations)):
        rows = [row for run in runs for row in read(run, limit)]
        write_table(folder / name, kept.with_training(name, rows))
    if experiment.tracks and experiment.picture in ("displacement", "goals", "turn"):
        first = [run for run in runs if run.job.seed == 1]
        best = [run for run in first if run.arm.role == "best"] or first
        rows = [row for run in best for row in logs.tracks(run)]
        write_table(folder / summary.TRACKS, kept.with_traces(summary.TRACKS, rows))


def _write_rides(
    folder: Path,
    experiment: Experiment,
    mode: str,
    length: Length,
    ridden: list[Ridden],
    kept: Kept,
    progress: bool,
) -> None:
    """Write the results of the rides without noise, and the picture's data."""
    rows: list[Row] = []
    label = f"{experiment.name} {mode}"
    for item in ProgressBar(ridden, desc=label, unit="controller", shown=progress):
        rows.append(evaluate_experiments.scored(experiment, mode, item, length.rides))
    write_table(folder / summary.RIDES, kept.with_rides(summary.RIDES, rows))
    if not experiment.tracks:
        return
    once = {(item.name, item.variant.name): item for item in reversed(ridden)}
    count = experiment.tracks if length.rides >= experiment.tracks else length.rides
    _write_traces(folder, experiment, mode, list(reversed(once.values())), count, kept)


def _write_traces(
    folder: Path,
    experiment: Experiment,
    mode: str,
    ridden: list[Ridden],
    count: int,
    kept: Kept,
) -> None:
    """Write the states of a ride, the tracks of many, or their speed profile."""
    plant = registry.named(physics=mode)
    rows: dict[str, list[Row]] = {}
    best = next((item for item in ridden if item.role == "best" and item.seed == 0), None)
    best = best or next((item for item in ridden if item.role == "best"), None)
    for item in ridden:
        traced = evaluate_experiments.trace(
            item.controller, experiment.ridden(item.variant), plant, count
        )
        if experiment.picture == "states":
            rows.setdefault(summary.STATES, []).extend(
                evaluate_experiments.states(item, traced, plant)
            )
        if experiment.picture in ("turn", "speed"):
            rows.setdefault(summary.PROFILES, []).extend(
                evaluate_experiments.profile(item, traced)
            )
        if experiment.picture == "goals" and item is best:
            rows.setdefault(summary.WAYS, []).extend(evaluate_experiments.ways(item, traced))
    for name, table in rows.items():
        write_table(folder / name, kept.with_traces(name, table))


def _write_json(path: Path, value: dict[str, Any]) -> None:
    write_atomically(path, json.dumps(value, indent=1, ensure_ascii=False).encode() + b"\n")
