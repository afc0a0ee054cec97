"""Parameters of the trainer; no ROS here."""

from __future__ import annotations

import os
import shlex
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bicycle_common.parameters import parameter
from bicycle_controller.trainer_service.order import TrainingOrder
from bicycle_sim.plants.base import Plant
from bicycle_sim.task.scenario import Scenario


@dataclass(frozen=True)
class TrainerSettings:
    """ROS parameters of the trainer."""

    mode: str = parameter(
        "live",
        "learn from the running bicycle, or from recorded bags",
        choices=("live", "bags"),
    )
    bags: str = parameter("", "bags or folders of bags, with ':' between; live: to begin with")
    out: str = parameter("", "the run's folder; a new one of the workspace's runs unless named")
    resume: bool = parameter(False, "go on with the run in that folder")
    preset: str = parameter("offline", "configuration to learn with, as of bicycle learn")
    overrides: str = parameter("", "changes of it, NAME=VALUE with blanks between")
    warm_up: int = parameter(2000, "transitions before the first update, live", 1, 10**9)
    updates_per_step: float = parameter(
        4.0, "most updates for each transition that has come, live", 0.001, 1000.0
    )
    hand_over: bool = parameter(True, "have the controller load what beats its policy")
    in_charge: str = parameter(
        "", "the policy to beat: a file, a shipped name or lqr; asks the controller unless named"
    )

    def folder(self) -> Path:
        """Return the run's folder."""
        if self.out:
            return Path(self.out)
        workspace = Path(os.environ.get("BICYCLE_WS", "."))
        return workspace / "runs" / time.strftime("trainer-%Y-%m-%d-%H%M%S")

    def order(
        self, scenario: Scenario | None = None, plant: Plant[Any] | None = None
    ) -> TrainingOrder:
        """Return the order for the learning process.

        Raises:
            ValueError: on invalid overrides, or if bags are missing.
        """
        bags = tuple(path for path in self.bags.split(os.pathsep) if path)
        if self.mode == "bags" and not bags and not self.resume:
            raise ValueError("mode:=bags needs bags:=PATH, or resume:=true with out:=FOLDER")
        if self.resume and not self.out:
            raise ValueError("resume:=true needs the run's folder, out:=FOLDER")
        return TrainingOrder(
            folder=self.folder(),
            preset=self.preset,
            overrides=tuple(shlex.split(self.overrides)),
            bags=bags,
            live=self.mode == "live",
            resume=self.resume,
            warm_up=self.warm_up,
            updates_per_step=self.updates_per_step,
            scenario=scenario,
            plant=plant,
        )
