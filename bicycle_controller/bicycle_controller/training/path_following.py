"""The run of `bicycle train path-following`: learn to follow, keep the best, tell how it goes."""

from __future__ import annotations

import csv
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bicycle_common.signals import InterruptError, StopRequest
from bicycle_common.validation import require
from bicycle_controller.control import followers
from bicycle_controller.control.learned_follower import LearnedFollower, Network
from bicycle_controller.evaluation.course_rides import Start, ride_courses
from bicycle_controller.evaluation.course_score import random_road
from bicycle_controller.training.path_learner import PathLearner, PathLearning
from bicycle_controller.training.path_task import PathTask
from bicycle_controller.training.run_folder import origin
from bicycle_sim.plants.base import Plant

BICYCLES = 64
IMITATION = 0.3
"""Share of the steps in which the actor only imitates."""
UPDATES = 8
"""Updates after each step of all bicycles."""
ROADS = 40
"""Roads on which an actor is scored."""
NAME = "follower.npz"


@dataclass(frozen=True)
class Scored:
    """Score of an actor on the fixed roads."""

    rms: float
    """m."""
    largest: float
    """m."""
    lost: int
    """Falls and roads not ridden to their end."""

    @property
    def rank(self) -> tuple[int, float]:
        """Order: the lower, the better."""
        return self.lost, self.rms


@dataclass(frozen=True)
class Result:
    """End of a run."""

    signal: int
    """Number of the signal that interrupted it; 0 if it finished."""
    steps: int
    """Environment steps made."""
    best: Scored | None
    """Score of the follower in the folder; None if it was interrupted before the first one."""


def run(
    plant: Plant[Any],
    out: Path,
    seed: int = 1,
    steps: int = 200_000,
    report: Callable[[str], None] = print,
    torque_limit: float = 2.0,
) -> Result:
    """Train; write follower.npz, log.csv and run.json.

    A signal ends it: the best follower so far stays, or the actor as it is before there is one.

    Args:
        plant: the bicycle.
        out: new or empty folder.
        seed: of everything.
        steps: environment steps over all bicycles.
        report: takes lines about the progress.
        torque_limit: N m, largest |T|.

    Raises:
        ValueError: if the folder holds something, or steps are too few.
    """
    require(steps >= 10 * BICYCLES, f"{steps} steps: choose {10 * BICYCLES} at least")
    taken = out.is_dir() and any(out.iterdir())
    require(not taken, f"{out} is not empty: choose another --out")
    out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    about = {**origin(), "seed": seed, "steps": steps, "torque_limit": torque_limit}
    (out / "run.json").write_text(json.dumps(about, indent=2) + "\n")
    task = PathTask(plant, BICYCLES, seed, torque_limit=torque_limit)
    learner = PathLearner(PathLearning(), seed)
    rng = np.random.default_rng([seed, 1])
    rounds = steps // BICYCLES
    every = max(1, rounds // 20)
    steps_done = 0
    best: Scored | None = None
    begun = time.monotonic()

    def network() -> Network:
        return Network(*learner.actor.arrays(), plant.to_json(), json.dumps(about))

    with StopRequest() as interrupt, (out / "log.csv").open("w", newline="") as file:
        log = csv.writer(file)
        log.writerow(["steps", "phase", "rms_m", "largest_m", "lost", "wall_s"])
        for number in range(rounds):
            if interrupt.requested:
                break
            imitates = number < IMITATION * rounds
            learner.anneal(number / rounds)
            _ride(task, learner, rng, mixed=max(0.0, 1.0 - 3.0 * number / (IMITATION * rounds)))
            for _ in range(UPDATES):
                if imitates:
                    learner.imitate()
                    learner.improve(actor_too=False)
                else:
                    learner.improve()
            steps_done = (number + 1) * BICYCLES
            if (number + 1) % every and number + 1 < rounds:
                continue
            now = network()
            try:
                with interrupt.at_once():
                    scored = score(LearnedFollower(plant, task.follower.config, now), plant)
            except InterruptError:
                break
            phase = "imitation" if imitates else "ddpg"
            wall = time.monotonic() - begun
            row = [f"{scored.rms:.4f}", f"{scored.largest:.3f}", scored.lost, f"{wall:.0f}"]
            log.writerow([steps_done, phase, *row])
            file.flush()
            report(
                f"{steps_done} steps, {phase}: {scored.rms:.3f} m rms, "
                f"{scored.largest:.2f} m at most, {scored.lost} of {ROADS} lost, {wall:.0f} s"
            )
            if best is None or scored.rank <= best.rank:
                best = scored
                now.save(out / NAME)
        if best is None:
            network().save(out / NAME)
    return Result(interrupt.signal, steps_done, best)


def _ride(task: PathTask, learner: PathLearner, rng: np.random.Generator, mixed: float) -> None:
    """Ride one period and remember it; a share `mixed` of the bicycles by the teacher."""
    before, teacher = task.observation, task.teacher
    action = learner.act(before) + learner.config.noise * rng.standard_normal(task.count)
    action = np.where(rng.random(task.count) < mixed, teacher, action)
    action = np.clip(action, -1.0, 1.0)
    after, reward, lost, _ = task.step(action)
    numbers = np.column_stack([action, teacher, reward])
    learner.remember(np.column_stack([before, numbers, lost, after]))


def score(follower: LearnedFollower, plant: Plant[Any]) -> Scored:
    """Ride the fixed random roads, from their start."""
    rng = np.random.default_rng(1_000_003)
    radius = followers.tightest(follower)
    roads = [random_road(rng, radius / 0.8, 100.0) for _ in range(ROADS)]
    found, _ = ride_courses(follower, plant, roads, [3.0] * ROADS, start=Start.on_path(ROADS))
    lost = int((found.fallen | ~found.finished).sum())
    rms = float(np.sqrt(np.average(found.rms**2, weights=found.time)))
    return Scored(rms, float(found.largest.max()), lost)
