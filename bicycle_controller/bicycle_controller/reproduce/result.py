"""Result of an experiment in one mode of the physics, read from its folder."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bicycle_controller.reproduce import experiment as experiments
from bicycle_controller.reproduce.experiment import MODES, Experiment


@dataclass(frozen=True)
class ExperimentResult:
    """One experiment in one mode of the physics, from its folder."""

    experiment: Experiment
    mode: str
    folder: Path
    summary: dict[str, Any]
    run: dict[str, Any]


def collect(out: Path) -> list[ExperimentResult]:
    """Return the results in a folder, in the paper's order."""
    found = []
    for name in [*experiments.names(), *experiments.causes()]:
        for mode in MODES:
            folder = out / name / mode
            if (folder / "summary.json").exists():
                texts = [(folder / f"{part}.json").read_text() for part in ("summary", "run")]
                parts = [json.loads(text) for text in texts]
                found.append(ExperimentResult(experiments.load(name), mode, folder, *parts))
    return found


def title(item: Experiment) -> str:
    """Return an experiment's title on its page."""
    if item.picture == "cause":
        return item.title
    return item.name.replace("figure-", "Figure ").replace("robustness", "Robustness")
