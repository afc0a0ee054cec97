"""What the learning process is to do."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bicycle_sim.plants.choi.parameters import Physics
from bicycle_sim.task.scenario import Scenario


@dataclass(frozen=True)
class TrainingOrder:
    """What the learning process is to do."""

    folder: Path
    """The run's; see `run_folder`."""
    preset: str
    overrides: tuple[str, ...]
    bags: tuple[str, ...]
    """Recorded rides to learn from, in live mode to begin with."""
    live: bool
    """Whether transitions come while it learns."""
    resume: bool
    """Whether to go on with the run in the folder."""
    warm_up: int
    """Transitions before the first update, in live mode."""
    updates_per_step: float
    """Most updates for each transition that has come, in live mode."""
    scenario: Scenario | None = None
    """That of the running simulator; None takes the bags'."""
    physics: Physics | None = None
