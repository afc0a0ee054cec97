"""Run of `bicycle train path-following`: learn to follow random roads, and keep the best follower.

A run's folder has path-following.json, its configuration; run.json, log.jsonl and checkpoint as
in `run_folder`; and follower.npz, the follower with the best score.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from bicycle_common.validation import reject_unknown, require, require_between, require_positive
from bicycle_controller.control import followers
from bicycle_controller.control.learned_follower import LearnedFollower, Network
from bicycle_controller.evaluation.course_rides import Start, ride_courses
from bicycle_controller.evaluation.course_score import random_road
from bicycle_controller.training.logger import Logger, Progress, Shown
from bicycle_controller.training.path_learner import PathLearner, PathLearning
from bicycle_controller.training.path_task import PathTask
from bicycle_controller.training.run_folder import PATH_CONFIG, RunFolder
from bicycle_controller.training.session import Result, TrainingSession
from bicycle_sim.plants import registry
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
class PathRun:
    """Configuration of a run.

    Raises:
        ValueError: on a value out of range.
    """

    plant: Plant[Any]
    """The bicycle."""
    seed: int = 1
    """Seed of everything that is random."""
    steps: int = 200_000
    """Environment steps over all bicycles."""
    torque_limit: float = 2.0
    """N m, largest |T|."""
    save_every: float = 30.0
    """Time between two checkpoints, s."""
    threads: int = field(default=1, init=False)
    tensorboard: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        least = 10 * BICYCLES
        require(self.steps >= least, f"{self.steps} steps: choose {least} at least")
        require_positive("torque_limit", self.torque_limit)
        for name in ("seed", "save_every"):
            require_between(name, getattr(self, name), 0.0, float("inf"))

    def dump(self) -> str:
        """Return JSON from which `load` reads an equal configuration."""
        tree = {name: getattr(self, name) for name in WRITTEN}
        return json.dumps(tree | {"plant": json.loads(self.plant.to_json())}, indent=2) + "\n"

    @classmethod
    def load(cls, file: Path) -> PathRun:
        """Read a configuration.

        Raises:
            ValueError: if the file cannot be read, or on an unknown key or value.
        """
        try:
            tree = json.loads(file.read_text())
            require(isinstance(tree, dict) and "plant" in tree, "it names no plant")
            reject_unknown(cls, tree)
            return cls(**tree | {"plant": registry.from_dict(tree["plant"])})
        except (OSError, ValueError, TypeError, RecursionError) as error:
            reason = " ".join(str(error).split())
            raise ValueError(f"cannot read the configuration {file}: {reason}") from None


WRITTEN = ("seed", "steps", "torque_limit", "save_every")
"""Fields in the file, besides the plant."""


@dataclass(frozen=True)
class RoadScore:
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


def run(
    config: PathRun,
    folder: Path,
    progress: Shown = False,
    stop: Callable[[], bool] = lambda: False,
) -> Result[RoadScore]:
    """Train in a new folder until the steps are made or `stop` is True.

    Args:
        config: the whole run.
        folder: new or empty.
        progress: True to draw a bar on standard error, `lines` to print lines there.
        stop: checked after every step of all bicycles.

    Raises:
        ValueError: if the folder holds something.
        BusyError: if another process trains there.
    """
    files = RunFolder(folder, PATH_CONFIG)
    require(not files.config.exists(), f"{folder} holds a run already: go on with --resume")
    taken = folder.is_dir() and any(folder.iterdir())
    require(not taken, f"{folder} is not empty: choose another --out")
    with files.held():
        files.begin(config.dump(), config.seed)
        return PathFollowing(config, files).train(progress, stop)


def resume(
    folder: Path,
    changes: dict[str, Any] | None = None,
    progress: Shown = False,
    stop: Callable[[], bool] = lambda: False,
) -> Result[RoadScore]:
    """Resume the run in `folder` from its last checkpoint, to the bit.

    Args:
        folder: the run's folder.
        changes: values by name that were asked for; the run must have them already.
        progress: True to draw a bar on standard error, `lines` to print lines there.
        stop: checked after every step of all bicycles.

    Raises:
        ValueError: if there is no run, it cannot be read, or it has other values.
        BusyError: if another process trains there.
    """
    files = RunFolder(folder, PATH_CONFIG)
    files.require()
    with files.held():
        config = PathRun.load(files.config)
        for name in changes or {}:
            same = replace(config, **{name: (changes or {})[name]}) == config
            require(same, f"{name} cannot change when this run goes on: choose another --out")
        files.clean()
        session = PathFollowing(config, files)
        session.restore()
        return session.train(progress, stop)


class PathFollowing(TrainingSession[RoadScore]):
    """One run.

    Attributes:
        rounds: steps of all bicycles so far.
    """

    score_type = RoadScore

    def __init__(self, config: PathRun, files: RunFolder) -> None:
        """Draw the roads and the weights."""
        super().__init__(config, files)
        self.config = config
        limit = config.torque_limit
        self.task = PathTask(config.plant, BICYCLES, config.seed, torque_limit=limit)
        self.learner = PathLearner(PathLearning(), config.seed)
        self.rng = np.random.default_rng([config.seed, 1])
        self.rounds = 0

    def leave_actor(self) -> None:
        """Write it where no actor has a score yet."""
        if self.best is None:
            self.network().save(self.files.path / NAME)

    @property
    def done(self) -> int:
        """Environment steps made."""
        return self.rounds * BICYCLES

    @property
    def budget(self) -> int:
        """Environment steps to be made, in whole rounds."""
        return self._last * BICYCLES

    @property
    def _last(self) -> int:
        return self.config.steps // BICYCLES

    def _imitates(self, number: int) -> bool:
        """Return True if the actor only imitates in a round."""
        return number < IMITATION * self._last

    def step(self, log: Logger, bar: Progress) -> None:
        """Ride one period and make its updates."""
        imitates = self._imitates(self.rounds)
        self.learner.anneal(self.rounds / self._last)
        self._ride(max(0.0, 1.0 - 3.0 * self.rounds / (IMITATION * self._last)))
        for _ in range(UPDATES):
            if imitates:
                self.learner.imitate()
            self.learner.improve(actor_too=not imitates)
        self.rounds += 1
        self.updates = self.learner.updates
        self.evaluation_due = self.rounds % max(1, self._last // 20) == 0 or self.finished
        bar.advance(BICYCLES)

    def _ride(self, mixed: float) -> None:
        """Ride one period and remember it; a share `mixed` of the bicycles by the teacher."""
        task, learner, rng = self.task, self.learner, self.rng
        before, teacher = task.observation, task.teacher
        action = learner.act(before) + learner.config.noise * rng.standard_normal(task.count)
        action = np.where(rng.random(task.count) < mixed, teacher, action)
        action = np.clip(action, -1.0, 1.0)
        after, reward, lost, _ = task.step(action)
        numbers = np.column_stack([action, teacher, reward])
        learner.remember(np.column_stack([before, numbers, lost, after]))

    def network(self) -> Network:
        """Return the present actor as a follower's network."""
        config = self.config
        own = {"seed": config.seed, "steps": config.steps, "torque_limit": config.torque_limit}
        about = json.dumps(self.begun | own)
        return Network(*self.learner.actor.arrays(), config.plant.to_json(), about)

    def score_actor(self) -> RoadScore:
        """Return the score of the actor on the fixed random roads."""
        plant = self.config.plant
        follower = LearnedFollower(plant, self.task.follower.config, self.network())
        return score(follower, plant)

    def take_score(self, found: RoadScore, log: Logger, bar: Progress) -> bool:
        """Keep the actor if none was better; return False."""
        if self.best is None or found.rank <= self.best.rank:
            self.best = found
            self.network().save(self.files.path / NAME)
        phase = "imitation" if self._imitates(self.rounds - 1) else "ddpg"
        log.write("evaluation", self.done, self.row({"phase": phase} | asdict(found)))
        bar.show(rms=found.rms, largest=found.largest, lost=found.lost)
        return False

    def state_dict(self) -> dict[str, Any]:
        """Return everything that future numbers depend on."""
        return super().state_dict() | {
            "task": self.task.state_dict(),
            "learner": self.learner.state_dict(),
            "rng": self.rng.bit_generator.state,
            "rounds": self.rounds,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`, to the bit."""
        super().load_state_dict(state)
        self.task.load_state_dict(state["task"])
        self.learner.load_state_dict(state["learner"])
        self.rng.bit_generator.state = state["rng"]
        self.rounds = state["rounds"]


def score(follower: LearnedFollower, plant: Plant[Any]) -> RoadScore:
    """Ride the fixed random roads, from their start."""
    rng = np.random.default_rng(1_000_003)
    radius = followers.tightest(follower)
    roads = [random_road(rng, radius / 0.8, 100.0) for _ in range(ROADS)]
    found, _ = ride_courses(follower, plant, roads, [3.0] * ROADS, start=Start.on_path(ROADS))
    lost = int((found.fallen | ~found.finished).sum())
    rms = float(np.sqrt(np.average(found.rms**2, weights=found.time)))
    return RoadScore(rms, float(found.largest.max()), lost)
