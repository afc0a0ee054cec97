"""Numbers of RESULTS.md from the raw data alone: `summarise` reads only CSVs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from bicycle_common.observation import OBSERVATION_FIELDS
from bicycle_controller.reproduce.tables import (
    Row,
    column,
    distinct,
    interval,
    read_table,
    select,
    share,
)

CURVES, EVALUATIONS, RIDES = "curves.csv", "evaluations.csv", "rides.csv"
TRACKS, WAYS, STATES, PROFILES = "tracks.csv", "ways.csv", "states.csv", "profiles.csv"
TENTH = 0.1
"""Share of a run that counts as its beginning and its end."""
MEASURES = ("return", "steps", "reached", "fallen", "distance", "speed")
TERMS = ("lean_angle", "lean_rate", "lean_acceleration", "heading_error")
END_SECONDS = 1.0
"""Duration at the end of a ride that counts as its end (s)."""


def summarise(folder: Path) -> dict[str, Any]:
    """Summarise a folder's CSVs, ready for JSON; see the parts for its keys."""
    return {
        "training": training(read_table(folder / CURVES)),
        "rides": rides(read_table(folder / RIDES)),
        "states": states(read_table(folder / STATES)),
        "profiles": profiles(read_table(folder / PROFILES)),
    }


def training(rows: list[Row]) -> list[dict[str, Any]]:
    """Summarise each arm on each variant: `first` and `last` tenth of its runs, [mean, low, high].

    `return`, `steps` and so on are means per episode; the intervals are over the runs, and
    `return_by_run` is what they are made of. `length` is in full episodes, of the shortest run,
    `longest` of the longest.
    """
    found = []
    for arm, role, variant in distinct(rows, "arm", "role", "variant"):
        mine = select(rows, arm=arm, variant=variant)
        seeds = [seed for (seed,) in distinct(mine, "seed")]
        ends = [column(select(mine, seed=seed), "at").max() for seed in seeds]
        entry: dict[str, Any] = {"arm": arm, "role": role, "variant": variant}
        entry |= {"runs": len(seeds), "length": float(min(ends)), "longest": float(max(ends))}
        for part in ("first", "last"):
            by_run = {
                name: [_tenth(select(mine, seed=seed), name, part) for seed in seeds]
                for name in (*MEASURES, *TERMS)
            }
            entry[part] = {name: interval(values) for name, values in by_run.items()}
            counts = [_episodes(select(mine, seed=seed), part) for seed in seeds]
            for name in ("reached", "fallen"):
                hits = np.clip(np.rint(np.multiply(by_run[name], counts)), 0, counts)
                entry[part][name] = share(hits, counts)
            entry[part]["return_by_run"] = by_run["return"]
        found.append(entry)
    return found


def _tenth(rows: list[Row], name: str, part: str) -> float:
    """Return the mean over the episodes of the first or the last tenth of one run."""
    mine, weights = _within(rows, part), column(rows, "episodes")
    return float(np.average(column(rows, name)[mine], weights=weights[mine]))


def _episodes(rows: list[Row], part: str) -> int:
    """Return the number of episodes in the first or the last tenth of one run."""
    return int(column(rows, "episodes")[_within(rows, part)].sum())


def _within(rows: list[Row], part: str) -> np.ndarray:
    """Return which rows of one run belong to its first or last tenth."""
    at = column(rows, "at")
    end = at.max()
    return at <= max(TENTH * end, at.min()) if part == "first" else at > (1.0 - TENTH) * end


def rides(rows: list[Row]) -> list[dict[str, Any]]:
    """Summarise each controller on each variant, over the runs of its training.

    Rates are `tables.share` of all rides; `return`, `steps`, `time_s` and so on are [mean, low,
    high] over runs.
    """
    found = []
    for rider, role, variant in distinct(rows, "rider", "role", "variant"):
        mine = select(rows, rider=rider, variant=variant)
        total = int(column(mine, "rides").sum())
        entry: dict[str, Any] = {"rider": rider, "role": role, "variant": variant}
        entry |= {"runs": len(mine), "rides": total}
        for name in ("reached", "fallen", "orbits"):
            entry[name] = share(column(mine, name), column(mine, "rides"))
        for name in ("reached", "fallen"):
            entry[f"{name}_by_run"] = (column(mine, name) / column(mine, "rides")).tolist()
        entry["time_s"] = interval(column(mine, "median_time_s"))
        for name in ("return", "steps", "path_ratio", "peak_lean", "speed"):
            entry[name] = interval(column(mine, name))
        found.append(entry)
    return found


def states(rows: list[Row]) -> list[dict[str, Any]]:
    """Summarise each controller's ride: every state's largest size, also in the last second."""
    found = []
    for rider, role in distinct(rows, "rider", "role"):
        mine = select(rows, rider=rider)
        time = column(mine, "time")
        entry: dict[str, Any] = {"rider": rider, "role": role, "seconds": float(time.max())}
        entry["reached"] = bool(mine[0]["reached"])
        late = time > time.max() - END_SECONDS
        for name in OBSERVATION_FIELDS:
            size = np.abs(column(mine, name))
            entry[name] = {"peak": float(size.max()), "end": float(size[late].mean())}
        found.append(entry)
    return found


def profiles(rows: list[Row]) -> list[dict[str, Any]]:
    """Summarise each controller's mean speed: start, least, after 100 steps, end."""
    found = []
    for rider, variant in distinct(rows, "rider", "variant"):
        mine = select(rows, rider=rider, variant=variant)
        step, speed = column(mine, "step"), column(mine, "speed")
        least = int(np.argmin(speed))
        entry: dict[str, Any] = {"rider": rider, "variant": variant}
        entry |= {"start": float(speed[0]), "least": float(speed[least])}
        entry |= {"least_at": int(step[least]), "end": float(speed[-1]), "end_at": int(step[-1])}
        entry["at_100"] = float(np.interp(100, step, speed))
        entry["heading_error_at_least"] = float(column(mine, "heading_error")[least])
        found.append(entry)
    return found
