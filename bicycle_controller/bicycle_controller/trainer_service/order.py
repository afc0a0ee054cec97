"""Order for the learning process."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bicycle_sim.plants.base import Plant
from bicycle_sim.task.scenario import Scenario


@dataclass(frozen=True)
class TrainingOrder:
    """Settings of the learning process."""

    folder: Path
    """Folder of the run; see `run_folder`."""
    preset: str
    overrides: tuple[str, ...]
    bags: tuple[str, ...]
    """Recorded rides to learn from; in live mode they come first."""
    live: bool
    """True if transitions arrive during learning."""
    resume: bool
    """True to resume the run in the folder."""
    warm_up: int
    """Transitions before the first update, in live mode."""
    updates_per_step: float
    """Largest number of updates per received transition, in live mode."""
    scenario: Scenario | None = None
    """Scenario of the running simulator; None uses the bags'."""
    plant: Plant[Any] | None = None
