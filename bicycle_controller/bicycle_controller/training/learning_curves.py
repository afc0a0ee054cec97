"""Learning curves of runs and sweeps: medians over seeds, with intervals."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bicycle_controller.config import loading
from bicycle_controller.config.run import RunConfig
from bicycle_controller.training.run_folder import RunFolder

VALUES = {
    "reach_rate": "evaluation",
    "fall_rate": "evaluation",
    "orbit_rate": "evaluation",
    "median_time_s": "evaluation",
    "mean_return": "evaluation",
    "near_reach_rate": "evaluation",
    "return": "train",
    "goal_rate": "train",
    "critic_loss": "train",
}
"""Curves that can be drawn, by the kind of line in `log.jsonl`."""
AXES = {"step": "environment steps", "updates": "updates", "cpu_s": "processor time (s)"}
"""Horizontal axes of a curve."""


@dataclass(frozen=True)
class Curve:
    """One configuration's seeds over common points."""

    name: str
    seeds: int
    at: np.ndarray
    """(P,) points."""
    middle: np.ndarray
    """(P,) median over seeds."""
    low: np.ndarray
    """(P,) lower bound of the band."""
    high: np.ndarray
    """(P,) upper bound."""

    def summary(self) -> dict[str, Any]:
        """Return the curve's end, for people and JSON."""
        return {
            "name": self.name,
            "seeds": self.seeds,
            "last": float(self.middle[-1]),
            "low": float(self.low[-1]),
            "high": float(self.high[-1]),
            "best": float(np.nanmax(self.middle)),
        }


def interval(count: int) -> tuple[int, int]:
    """Return the order statistics (from 0) between which the true median of `count` seeds lies.

    With a probability of 95 % or more, by the binomial distribution; below six seeds no two
    order statistics do, so that it is the whole range.
    """
    for low in range(count // 2, -1, -1):
        outside = 2.0 * sum(math.comb(count, k) for k in range(low + 1)) / 2.0**count
        if outside <= 0.05:
            return low, count - 1 - low
    return 0, count - 1


def find(folders: Sequence[Path]) -> list[Path]:
    """Return the run folders in `folders`, at any depth.

    Raises:
        ValueError: if one of them holds none.
    """
    found: list[Path] = []
    for folder in folders:
        runs = sorted(path.parent for path in folder.rglob("config.yaml"))
        runs = [run for run in runs if (run / "log.jsonl").is_file()]
        if not runs:
            raise ValueError(
                f"{folder} holds no run: give a folder that 'bicycle train' or 'sweep' wrote"
            )
        found += [run for run in runs if run not in found]
    return found


def read(folders: Sequence[Path], value: str, over: str) -> list[Curve]:
    """Return one curve for each configuration, its seeds together.

    Args:
        folders: of runs, or that hold runs.
        value: one of VALUES.
        over: one of AXES.

    Raises:
        ValueError: if there is no run, or none has such a value yet.
    """
    groups: dict[str, list[tuple[RunConfig, Path, np.ndarray]]] = {}
    for run in find(folders):
        config = loading.load(RunFolder(run).config)
        points = _points(run, value, over)
        if len(points):
            key = repr(replace(config, seed=0))
            groups.setdefault(key, []).append((config, run, points))
    if not groups:
        raise ValueError(f"no {value} has been logged there yet: train on, or give another --of")
    names = _names([runs[0] for runs in groups.values()])
    return [
        _curve(name, [points for _, _, points in runs])
        for name, runs in zip(names, groups.values(), strict=True)
    ]


def _points(run: Path, value: str, over: str) -> np.ndarray:
    """Return (P, 2): where and what, in order; lines that are damaged or lack it are left out."""
    rows = []
    for line in (run / "log.jsonl").read_text().splitlines():
        try:
            row = json.loads(line)
        except ValueError:
            continue
        if row.get("kind") == VALUES[value] and None not in (row.get(value), row.get(over)):
            rows.append((float(row[over]), float(row[value])))
    return np.array(sorted(rows)).reshape(-1, 2)


def _names(first: list[tuple[RunConfig, Path, np.ndarray]]) -> list[str]:
    """Name each configuration by preset and scenario, by its folder where these are the same."""
    names = [f"{config.preset or 'own'} {config.scenario.name}" for config, _, _ in first]
    return [
        name if names.count(name) == 1 else f"{name} ({run.parent.name}/{run.name})"
        for name, (_, run, _) in zip(names, first, strict=True)
    ]


def _curve(name: str, seeds: list[np.ndarray]) -> Curve:
    """Join the seeds of one configuration, as far as all of them go."""
    first = max(points[0, 0] for points in seeds)
    last = min(points[-1, 0] for points in seeds)
    at = np.unique(np.concatenate([points[:, 0] for points in seeds]))
    at = at[(at >= first) & (at <= last)]
    if len(at) == 0:  # the seeds do not overlap
        at = np.array([first])
    each = np.sort(np.stack([np.interp(at, *points.T) for points in seeds]), axis=0)
    low, high = interval(len(seeds))
    return Curve(name, len(seeds), at, np.median(each, axis=0), each[low], each[high])
