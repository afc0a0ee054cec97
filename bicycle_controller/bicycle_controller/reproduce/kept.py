"""Results of runs made on another machine: they are kept when new ones are added.

Training runs are large and stay where they were made; only a folder of CSVs is kept of them. If
that folder contains rows of a run that is missing here, and the experiment is the same, its rows
and its line of `run.json` are kept.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from bicycle_controller.reproduce.experiment import Experiment
from bicycle_controller.reproduce.tables import Row, read_table

SAME = ("scenario", "set", "ride_set", "limit", "variants", "train_variants", "tracks")
"""Fields that must be equal between two experiments whose rows share a table."""
Key = tuple[str, str, int]
"""Arm, variant and seed."""


class Kept:
    """Content of a folder about runs that were made elsewhere.

    Attributes:
        training: their entries of `run.json`.
    """

    def __init__(
        self, folder: Path, experiment: Experiment, own: Iterable[Key], rides: int
    ) -> None:
        """Read the folder.

        Args:
            folder: of the experiment in one mode; may be empty.
            experiment: the current one.
            own: the runs on this machine.
            rides: number of rides of each score.
        """
        self._folder, self._experiment = folder, experiment
        file = folder / "run.json"
        old = json.loads(file.read_text()) if file.exists() else {"training": []}
        here, arms = set(own), self._same_arms(old, rides)
        self.training: list[dict[str, Any]] = [
            entry for entry in old["training"] if entry["arm"] in arms and _key(entry) not in here
        ]
        self._runs = {_key(entry) for entry in self.training}

    def _same_arms(self, old: dict[str, Any], rides: int) -> set[str]:
        """Return the arms whose rows may stay: none if the experiment is another."""
        now = json.loads(json.dumps(asdict(self._experiment)))
        then = old.get("experiment", {})
        if old.get("rides") != rides or any(then.get(name) != now[name] for name in SAME):
            return set()
        return {arm["name"] for arm in now["arms"] if arm in then["arms"]}

    def with_training(self, name: str, rows: list[Row]) -> list[Row]:
        """Return the rows of training runs and the kept ones, in the order of the runs."""
        mine = [row for row in self._rows(name) if _key(row) in self._runs]
        return self.ordered([*rows, *mine])

    def with_rides(self, name: str, rows: list[Row]) -> list[Row]:
        """Return the rows of scored controllers, and those that are kept."""
        mine = [row for row in self._rows(name) if self._keeps(row)]
        return self.ordered([*rows, *mine])

    def with_traces(self, name: str, rows: list[Row]) -> list[Row]:
        """Return the rows of single rides and those of controllers without any here."""
        there = {(row["rider"], row["variant"]) for row in rows}
        mine = [row for row in self._rows(name) if self._keeps(row)]
        return [*rows, *(row for row in mine if (row["rider"], row["variant"]) not in there)]

    def _keeps(self, ride: Row) -> bool:
        """Return True if a ride's controller is of a kept run; some rows name no seed."""
        seeds = {
            seed
            for arm, variant, seed in self._runs
            if arm == ride["rider"]
            and (variant == ride["variant"] or not self._experiment.train_variants)
        }
        return ride.get("seed", min(seeds, default=0)) in seeds

    def ordered(self, rows: list[Row]) -> list[Row]:
        """Sort runs by seed, variant and arm; rides by variant, trained controllers first."""
        item = self._experiment
        arms = [*(arm.name for arm in item.arms), *(rider.name for rider in item.riders)]
        variants = [variant.name for variant in item.variants]

        def place(row: Row) -> tuple[int, ...]:
            variant = variants.index(row["variant"]) if row["variant"] in variants else 0
            if "rider" not in row:
                return row["seed"], variant, arms.index(row["arm"])
            return variant, row["seed"] == 0, row["seed"], arms.index(row["rider"])

        return sorted(rows, key=place)

    def _rows(self, name: str) -> list[Row]:
        return read_table(self._folder / name) if self.training else []


def _key(row: dict[str, Any]) -> Key:
    return row["arm"], row["variant"], row["seed"]
