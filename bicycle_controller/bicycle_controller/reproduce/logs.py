"""Rows of raw data from the logs of a training run."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from bicycle_controller.reproduce.tables import Row
from bicycle_controller.reproduce.training import Run
from bicycle_controller.training.episode_log import TERMS, read_columns

BINS = 40
"""Points of a learning curve: the episodes of each stretch are averaged."""
TRACKS, TRACK_POINTS = 40, 20
"""Number of tracks kept of a run's training, evenly spaced, and points of each."""
MEANS = ("return", "steps", "upright", "reached", "fallen", "distance", "speed", *TERMS)


def curves(run: Run, limit: int) -> list[Row]:
    """Return the episodes of a run in up to BINS stretches of equal experience.

    `at` is the stretch's end in episodes of `limit` steps, over all bicycles, so that runs of many
    bicycles, or runs whose falls end an episode, are drawn over equal experience.
    """
    log = read_columns(run.job.folder / "episodes.csv")
    steps = log["end"].max(initial=0.0)
    if steps == 0:
        return []
    bins = int(min(BINS, max(1, len(log["end"]) // 2)))
    index = np.ceil(log["end"] / steps * bins).astype(int) - 1
    rows: list[Row] = []
    for number in range(bins):
        mine = index == number
        if mine.any():
            about = _about(run) | {"at": steps * (number + 1) / bins / limit}
            means = {name: float(log[name][mine].mean()) for name in MEANS}
            rows.append(about | {"episodes": int(mine.sum())} | means)
    return rows


def evaluations(run: Run, limit: int) -> list[Row]:
    """Return the scores without noise by which a run chose its best policy."""
    rows = []
    for line in (run.job.folder / "log.jsonl").read_text().splitlines():
        entry = json.loads(line)
        if entry["kind"] == "evaluation":
            names = ("mean_return", "reach_rate", "fall_rate", "median_time_s")
            values = {name: entry[name] for name in names}
            rows.append(_about(run) | {"at": entry["step"] / limit} | values)
    return rows


def tracks(run: Run) -> list[Row]:
    """Return some tracks of a run's training, with their age: 0 at its beginning, 1 at its end."""
    log = read_columns(run.job.folder / "tracks.csv")
    kept = np.unique(log["episode"])
    last = float(kept.max(initial=1.0)) or 1.0
    rows: list[Row] = []
    for episode in kept[_evenly(len(kept), TRACKS)]:
        mine = np.flatnonzero(log["episode"] == episode)
        for point in mine[_evenly(len(mine), TRACK_POINTS)]:
            where = {"x": round(log["x"][point], 2), "y": round(log["y"][point], 2)}
            age = {"episode": int(episode), "age": round(float(episode) / last, 4)}
            rows.append({"rider": run.arm.name, "variant": run.variant.name} | age | where)
    return rows


def _evenly(count: int, most: int) -> np.ndarray:
    """Return up to `most` indices from the first to the last of `count`."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(int))


def provenance(run: Run) -> dict[str, Any]:
    """Return the origin of a run, its length and its cost."""
    folder = run.job.folder
    origin = json.loads((folder / "run.json").read_text())
    about = _about(run) | {"preset": run.arm.preset, "scenario": run.job.scenario}
    about |= {key: origin[key] for key in ("command", "commit", "started")}
    about["processor"] = origin.get("processor", "unknown")
    result = json.loads(run.job.result.read_text())
    keys = ("status", "steps", "updates", "wall_s", "cpu_s", "error")
    return about | {key: result[key] for key in keys if key in result}


def _about(run: Run) -> Row:
    return {
        "arm": run.arm.name,
        "role": run.arm.role,
        "variant": run.variant.name,
        "seed": run.job.seed,
    }
