"""Rides of an experiment: scores of the controllers, and tracks and states of some rides."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bicycle_common.observation import ACTION_FIELDS, OBSERVATION_FIELDS
from bicycle_controller.control.riding import Riding
from bicycle_controller.evaluation.evaluate import evaluate
from bicycle_controller.policy.policy import load_controller
from bicycle_controller.reproduce.experiment import Experiment, Variant
from bicycle_controller.reproduce.tables import Row
from bicycle_controller.reproduce.training import Run
from bicycle_controller.training.run_folder import RunFolder
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant
from bicycle_sim.task.scenario import Scenario
from bicycle_sim.task.task import BicycleTask

if TYPE_CHECKING:
    from bicycle_controller.control.controller import Controller

SEED = 2019
"""Seed of the evaluation's starts; training chooses its best policy on others."""
WAY_POINTS = 25
"""Number of points kept of each track."""


@dataclass(frozen=True)
class Ridden:
    """One controller on one variant."""

    name: str
    role: str
    variant: Variant
    seed: int
    """Seed of its training; 0 if it was not trained here."""
    controller: Controller

    @property
    def about(self) -> Row:
        """Columns that identify it."""
        return {
            "rider": self.name,
            "role": self.role,
            "variant": self.variant.name,
            "seed": self.seed,
        }


def riders(experiment: Experiment, mode: str, runs: list[Run]) -> Iterator[Ridden]:
    """Yield every controller on every variant: the best policy of each run, then given ones."""
    plant = registry.named(physics=mode)
    for variant in experiment.variants:
        for run in runs:
            files = RunFolder(run.job.folder)
            path = files.best if files.best.exists() else files.last
            mine = not experiment.train_variants or run.variant == variant
            if mine and path.exists():
                controller = load_controller(str(path), plant)
                yield Ridden(run.arm.name, run.arm.role, variant, run.job.seed, controller)
        for rider in experiment.riders:
            if not rider.variants or variant.name in rider.variants:
                controller = load_controller(rider.controller, plant)
                yield Ridden(rider.name, rider.role, variant, 0, controller)


def scored(experiment: Experiment, mode: str, ridden: Ridden, rides: int) -> Row:
    """Return the results of `rides` rides without noise; all controllers get the same starts."""
    scenario, plant = experiment.ridden(ridden.variant), registry.named(physics=mode)
    found = evaluate(
        ridden.controller, scenario, plant, rides, SEED, disturbance=ridden.variant.trial
    )
    summary, outcomes = found.summary(), found.rides
    steps = np.where(outcomes.reached, outcomes.steps, scenario.max_steps)
    return ridden.about | {
        "rides": rides,
        "reached": int(outcomes.reached.sum()),
        "fallen": int(outcomes.fallen.sum()),
        "orbits": int(found.orbits.sum()),
        "median_time_s": summary["median_time_s"],
        "steps": float(steps.mean()),
        "path_ratio": summary["path_ratio_mean"],
        "peak_lean": summary["peak_lean"],
        "speed": summary["mean_speed"],
        "return": summary["mean_return"],
    }


@dataclass(frozen=True)
class ExperimentTrace:
    """N rides step by step: arrays of shape (steps + 1, N) or (steps + 1, N, 6 or 3)."""

    x: np.ndarray
    """Position of the rear contact, m."""
    y: np.ndarray
    speed: np.ndarray
    """m/s."""
    observation: np.ndarray
    action: np.ndarray
    """Action chosen after each state, within the limits."""
    length: np.ndarray
    """(N,), number of steps ridden."""
    reached: np.ndarray
    """bool, (N,)."""
    fallen: np.ndarray
    """bool, (N,)."""


def trace(
    controller: Controller, scenario: Scenario, plant: Plant[Any], count: int, seed: int = SEED
) -> ExperimentTrace:
    """Ride `count` bicycles to their ends and record every step."""
    task = BicycleTask(scenario, plant, count, np.random.default_rng((seed, 0, 0)))
    limits = scenario.action_limits
    going = np.ones(count, dtype=bool)
    length = np.zeros(count, dtype=np.int64)
    reached = np.zeros(count, dtype=bool)
    fallen = np.zeros(count, dtype=bool)
    kept: list[tuple[np.ndarray, ...]] = []
    observation = task.observation()
    riding = Riding(controller, count, plant)
    while True:
        state = task.state
        action = np.clip(riding.act(observation, state.speed), -limits, limits)
        riding.acted(observation, state.speed, action)
        kept.append((state.rear_x, state.rear_y, state.speed, observation, action))
        if not going.any():
            break
        step = task.step(action)
        observation = step.observation
        length += going
        reached |= going & step.terminated
        fallen |= going & step.fallen
        going &= ~(step.terminated | step.truncated | step.fallen)
    x, y, speed, seen, acted = (np.stack(values) for values in zip(*kept, strict=True))
    return ExperimentTrace(x, y, speed, seen, acted, length, reached, fallen)


def ways(ridden: Ridden, traced: ExperimentTrace) -> list[Row]:
    """Return the points of each ride's track."""
    rows: list[Row] = []
    for ride, length in enumerate(traced.length):
        points = np.unique(np.linspace(0, int(length), WAY_POINTS).astype(int))
        for point in points:
            where = {"x": round(float(traced.x[point, ride]), 2)}
            where["y"] = round(float(traced.y[point, ride]), 2)
            about: dict[str, Any] = {"rider": ridden.name, "variant": ridden.variant.name}
            rows.append(about | {"ride": ride, "reached": int(traced.reached[ride])} | where)
    return rows


def states(ridden: Ridden, traced: ExperimentTrace, plant: Plant[Any]) -> list[Row]:
    """Return every step of the first ride that reached its goal, or else of the first ride."""
    ride = int(np.argmax(traced.reached))
    rows: list[Row] = []
    for step in range(int(traced.length[ride]) + 1):
        row: Row = ridden.about | {"reached": int(traced.reached[ride]), "step": step}
        row["time"] = step * plant.time_step
        row |= dict(zip(OBSERVATION_FIELDS, traced.observation[step, ride].tolist(), strict=True))
        row |= dict(zip(ACTION_FIELDS, traced.action[step, ride].tolist(), strict=True))
        rows.append(row)
    return rows


def profile(ridden: Ridden, traced: ExperimentTrace, every: int = 4) -> list[Row]:
    """Return speed and absolute heading error by step, over the rides still running."""
    rows: list[Row] = []
    for step in range(0, int(traced.length.max()) + 1, every):
        going = traced.length >= step
        if going.sum() < max(2, 0.1 * len(going)):
            break  # the mean of a few rides does not represent all
        speed, error = traced.speed[step, going], np.abs(traced.observation[step, going, 5])
        low, high = np.quantile(speed, [0.025, 0.975])
        row: Row = {"rider": ridden.name, "variant": ridden.variant.name, "step": step}
        row |= {"riding": int(going.sum()), "speed": float(speed.mean())}
        row |= {"speed_low": float(low), "speed_high": float(high)}
        rows.append(row | {"heading_error": float(error.mean())})
    return rows
