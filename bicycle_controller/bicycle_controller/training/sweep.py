"""Many training runs: presets x scenarios x seeds, on this machine or as tasks of a Ray cluster.

Each run has its own folder, `OUT/PRESET/SCENARIO/seed-N`, as `bicycle train` creates it, with a
`result.json` once it is done. A restarted sweep skips finished runs and resumes the rest from
its checkpoints.
"""

from __future__ import annotations

import json
import os
import socket
import sys
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bicycle_common.progress import ProgressBar
from bicycle_common.signals import StopRequest
from bicycle_common.validation import one_line
from bicycle_controller.config import loading
from bicycle_controller.config.run import RunConfig
from bicycle_controller.policy.policy import load_policy, write_atomically
from bicycle_controller.training.local_pool import LocalPool, LostTaskError, Task
from bicycle_controller.training.run_folder import RunFolder

STORE_BYTES = 100 * 1024 * 1024
"""Size of Ray's shared memory: results are small, and containers have little of it."""
STARTS = 4
"""Number of attempts to start Ray."""
CONNECT_SECONDS = 5.0
STOP_SECONDS = 60.0
"""Time for interrupted runs to write their checkpoints (s)."""


@dataclass(frozen=True)
class Job:
    """One run of a sweep."""

    preset: str
    scenario: str
    seed: int
    config: RunConfig
    folder: Path

    @property
    def result(self) -> Path:
        """Path of the result, written when the run is done."""
        return self.folder / "result.json"


def plan(
    out: Path,
    presets: Iterable[str],
    scenarios: Iterable[str],
    seeds: Iterable[int],
    overrides: Iterable[loading.Override] = (),
) -> list[Job]:
    """Return every run of a sweep, those of the same seed together.

    Raises:
        ValueError: on an unknown name or value, or if a folder contains a run of another kind.
    """
    jobs = []
    for seed in seeds:
        for preset in presets:
            for scenario in scenarios:
                own = {"scenario": scenario, "seed": seed}
                config = loading.preset(preset, [own, *overrides])
                folder = out / preset / scenario / f"seed-{seed}"
                _check_same(folder, config)
                jobs.append(Job(preset, scenario, seed, config, folder))
    return jobs


def _check_same(folder: Path, config: RunConfig) -> None:
    """Refuse to mix runs with different settings in one sweep."""
    files = RunFolder(folder)
    if files.config.exists() and loading.load(files.config) != config:
        raise ValueError(
            f"{folder} holds a run with other settings: give the same ones, or another --out"
        )


def run_job(
    job: Job, episodes: int, command: list[str], progress: bool = False
) -> tuple[dict[str, Any], bytes]:
    """Train, or resume training, and score the best policy; executed by a worker.

    Args:
        job: to be trained.
        episodes: rides of the final score, on other starts than training chose its best on.
        command: the sweep's own command line, for the record.
        progress: True to draw a bar on standard error.

    Returns:
        The result and the policy file's bytes. The status is that of `online.Result`, or
        `failed` with an `error` if training itself gave up.
    """
    from bicycle_controller.evaluation.evaluate import evaluate
    from bicycle_controller.training import online

    sys.argv = command
    about = {"preset": job.preset, "scenario": job.scenario, "seed": job.seed}
    files = RunFolder(job.folder)
    try:
        begun = files.config.exists()
        if begun:
            trained = online.resume(job.folder, progress=progress)
        else:
            trained = online.run(job.config, job.folder, progress)
    except (ValueError, RuntimeError) as error:
        return about | {"status": "failed", "error": " ".join(str(error).split())}, b""
    path = files.best if files.best.exists() else files.last
    result = about | asdict(trained)
    if trained.status != "interrupted":
        found = evaluate(load_policy(path), job.config.scenario, job.config.physics, episodes)
        result["evaluation"] = found.summary()
    return result, path.read_bytes()


def sweep(
    jobs: list[Job],
    episodes: int,
    address: str | None = None,
    parallel: int | None = None,
    progress: bool = False,
) -> list[dict[str, Any]]:
    """Run all unfinished jobs.

    Args:
        jobs: from `plan`.
        episodes: rides of each final score.
        address: of a Ray cluster; by default this machine's processors are used.
        parallel: processors to use of this machine; all by default.
        progress: True to draw a bar on standard error.

    Returns:
        The results of all finished jobs, in the order of the jobs.

    Raises:
        ConnectionError: if no cluster answers at `address`, or Ray does not start.
        RuntimeError: if a worker was lost; finished results are kept.
    """
    left = [job for job in jobs if not job.result.exists()]
    if left:
        # Ray hands every run a GPU of its own.
        gpus = any(job.config.device.startswith("cuda") for job in left)
        done = len(jobs) - len(left)
        with ProgressBar(
            total=len(jobs), initial=done, desc="sweep", unit="run", shown=progress
        ) as bar:
            if address is None and not gpus:
                _run_here(parallel, left, episodes, bar)
            else:
                _run_on_ray(address, parallel, left, episodes, bar)
    return [json.loads(job.result.read_text()) for job in jobs if job.result.exists()]


def _run_here(parallel: int | None, jobs: list[Job], episodes: int, bar: Any) -> None:
    """Run every job in a process of its own and store each result when it arrives.

    Raises:
        RuntimeError: if a worker was lost.
    """
    pool = LocalPool() if parallel is None else LocalPool(parallel)
    by_name = {str(job.folder): job for job in jobs}
    for name, job in by_name.items():
        pool.add(Task(name, run_job, (job, episodes, sys.argv), job.config.threads))
    lost = []
    with StopRequest() as asked:
        while pool.left and not asked.signal:
            # A time limit, so that Ctrl-C is seen at once.
            for task, found in pool.done(timeout=1.0):
                if isinstance(found, LostTaskError):
                    lost.append(one_line(str(found)))
                else:
                    store(by_name[task.name], *found)
                bar.update()
        if asked.signal:
            print("stopping: each run saves its checkpoint", file=sys.stderr)
            pool.stop(STOP_SECONDS)
            raise KeyboardInterrupt
    _tell_lost(lost)


def _tell_lost(lost: list[str]) -> None:
    """Raise RuntimeError if workers were lost."""
    if lost:
        raise RuntimeError(f"{len(lost)} runs were lost, start the sweep again; first {lost[0]}")


def _run_on_ray(
    address: str | None, parallel: int | None, jobs: list[Job], episodes: int, bar: Any
) -> None:
    """Run all jobs as tasks of a cluster, or of a Ray that is started here."""
    ray = _connect(address, parallel)
    try:
        _run_all(ray, jobs, episodes, bar)
    finally:
        ray.shutdown()


def _connect(address: str | None, parallel: int | None) -> Any:
    """Start Ray or join a cluster."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    import ray

    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
    if address is None:
        own = {"num_cpus": parallel, "object_store_memory": STORE_BYTES, **quiet}
        _start(ray, address="local", include_dashboard=False, **own)
        return ray
    _check_reachable(address)
    import bicycle_controller
    import bicycle_sim

    # The cluster's machines need not have this code, only torch and its other dependencies.
    modules = [str(Path(item.__path__[0])) for item in (bicycle_sim, bicycle_controller)]
    ray.init(address=address, runtime_env={"py_modules": modules}, **quiet)
    return ray


def _start(ray: Any, **options: Any) -> None:
    """Start Ray; its own limit of 30 s can be too short on a busy machine.

    Raises:
        ConnectionError: if its processes do not start.
    """
    for _ in range(STARTS):
        try:
            ray.init(**options)
            return
        except Exception as error:  # Ray has no exception type of its own for this
            reason = (str(error).splitlines() or [type(error).__name__])[0]
            ray.shutdown()
    raise ConnectionError(
        f"Ray does not start, {STARTS} times tried ({reason}): make room on this machine, or name "
        "a running cluster with --ray-address"
    )


def _check_reachable(address: str) -> None:
    """Refuse an unreachable address, which Ray would try for many minutes.

    Raises:
        ConnectionError: if it is unreachable.
    """
    if address == "auto":
        return
    host, _, port = address.removeprefix("ray://").rpartition(":")
    try:
        socket.create_connection((host, int(port)), timeout=CONNECT_SECONDS).close()
    except (OSError, ValueError, OverflowError) as error:
        raise ConnectionError(
            f"no Ray cluster answers at {address!r} ({error}): give HOST:PORT of one that runs,"
            " or leave out --ray-address"
        ) from error


def _run_all(ray: Any, jobs: list[Job], episodes: int, bar: Any) -> None:
    """Start every job as a task and store each result when it arrives."""
    waiting = {}
    for job in jobs:
        gpus = 1 if job.config.device.startswith("cuda") else 0
        task = ray.remote(run_job).options(
            num_cpus=job.config.threads, num_gpus=gpus, max_retries=3
        )
        waiting[task.remote(job, episodes, sys.argv)] = job
    lost = []
    with StopRequest() as asked:
        while waiting and not asked.signal:
            # A time limit, so that Ctrl-C is seen at once.
            done, _ = ray.wait(list(waiting), timeout=1.0)
            for reference in done:
                job = waiting.pop(reference)
                try:
                    store(job, *ray.get(reference))
                except ray.exceptions.RayError as error:
                    lost.append(f"{job.folder}: {' '.join(str(error).split())[-300:]}")
                bar.update()
    if asked.signal:
        print("stopping: each run saves its checkpoint", file=sys.stderr)
        for reference in waiting:
            ray.cancel(reference)
        ray.wait(list(waiting), num_returns=len(waiting), timeout=STOP_SECONDS)
        raise KeyboardInterrupt
    _tell_lost(lost)


def store(job: Job, result: dict[str, Any], policy: bytes) -> None:
    """Store the result of a worker, which may run on another machine."""
    if result["status"] == "interrupted":
        return
    if policy and not RunFolder(job.folder).best.exists():
        write_atomically(RunFolder(job.folder).best, policy)
    write_atomically(job.result, json.dumps(result, indent=2).encode() + b"\n")


def groups(results: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the results of each preset on each scenario over its seeds.

    Returns:
        For each: `preset`, `scenario`, `runs`, `failed`, and over the runs that did not fail
        `reach_rate` and `fall_rate` as [least, median, largest], medians of `median_time_s`,
        `cpu_s` and `wall_s`.
    """
    found = []
    for preset, scenario in dict.fromkeys((item["preset"], item["scenario"]) for item in results):
        runs = [r for r in results if (r["preset"], r["scenario"]) == (preset, scenario)]
        good = [item for item in runs if item["status"] != "failed"]
        scores = [item["evaluation"] for item in good]
        times = [s["median_time_s"] for s in scores if s["median_time_s"] is not None]
        group = {"preset": preset, "scenario": scenario, "runs": len(runs)}
        group["failed"] = len(runs) - len(good)
        for name in ("reach_rate", "fall_rate"):
            group[name] = _spread([score[name] for score in scores])
        group["median_time_s"] = _median(times)
        for name in ("cpu_s", "wall_s"):
            group[name] = _median([item[name] for item in good])
        found.append(group)
    return found


def _spread(values: list[float]) -> list[float] | None:
    """Return [least, median, largest], or None for an empty list."""
    return [min(values), float(np.median(values)), max(values)] if values else None


def _median(values: list[float]) -> float | None:
    return float(np.median(values)) if values else None
