"""Training starts: the scenario's, plus near goals, tilted bicycles and continued rides."""

from __future__ import annotations

import dataclasses

import numpy as np

from bicycle_common.geometry import wrap_angle
from bicycle_controller.config.run import StartsConfig
from bicycle_sim.task.scenario import Scenario
from bicycle_sim.task.task import BicycleTask


def training_scenario(scenario: Scenario, starts: StartsConfig) -> Scenario:
    """Return the scenario with the step limit of training episodes."""
    return dataclasses.replace(scenario, max_steps=starts.max_steps or scenario.max_steps)


def restart(
    task: BicycleTask,
    mask: np.ndarray,
    starts: StartsConfig,
    any_speed: np.ndarray | None = None,
) -> None:
    """Start new episodes, drawing from the task's rng.

    Args:
        task: of N bicycles.
        mask: bool (N,), which of them start.
        starts: how.
        any_speed: bool (N,), which of them may have a speed of `starts.speeds`; all by default.
    """
    if not mask.any():
        return
    task.reset(mask)
    _disturb(task, mask, starts, mask if any_speed is None else any_speed & mask)
    _draw_near_goals(task, mask, starts)


def ride_on(task: BicycleTask, mask: np.ndarray, starts: StartsConfig) -> None:
    """Give the bicycles of `mask`, bool (N,), new goals without changing their state."""
    if not mask.any():
        return
    goal = task.scenario.goal.draw(int(mask.sum()), task.rng)
    task.goal_x[mask], task.goal_y[mask] = goal[:, 0], goal[:, 1]
    task.steps = np.where(mask, 0, task.steps)
    _draw_near_goals(task, mask, starts)


def _disturb(
    task: BicycleTask, mask: np.ndarray, starts: StartsConfig, any_speed: np.ndarray
) -> None:
    """Tilt and steer the bicycles that have just started."""
    spreads = {
        "lean_angle": starts.tilt,
        "lean_rate": starts.tilt_rate,
        "steer_angle": starts.steer,
        "steer_rate": starts.steer_rate,
    }
    if starts.any_speed and task.scenario.speed_limits is not None:
        speed = task.state.speed.copy()
        speed[mask] = task.rng.uniform(*task.scenario.speed_limits, int(mask.sum()))
        task.state.speed = speed
    if starts.speeds is not None:
        speed, (low, high) = task.state.speed.copy(), starts.speeds
        share = np.sin(0.5 * np.pi * task.rng.random(int(any_speed.sum()))) ** 2
        speed[any_speed] = low + (high - low) * share
        task.state.speed = speed
    for name, spread in spreads.items():
        if spread > 0:
            values = getattr(task.state, name).copy()
            values[mask] = task.rng.uniform(-spread, spread, int(mask.sum()))
            setattr(task.state, name, values)
    task.state = task.plant.settled(task.state)


def _draw_near_goals(task: BicycleTask, mask: np.ndarray, starts: StartsConfig) -> None:
    """Move a share of the goals of `mask` near their bicycles, at any bearing."""
    if starts.near_share == 0.0:
        return
    count = int(mask.sum())
    near = task.rng.random(count) < starts.near_share
    distance = task.rng.uniform(*starts.near_distance, count)
    bearing = wrap_angle(task.rng.uniform(-np.pi, np.pi, count))
    who = np.flatnonzero(mask)[near]
    distance, bearing = distance[near], bearing[near]
    task.goal_x[who] = task.state.rear_x[who] - distance * np.sin(bearing)
    task.goal_y[who] = task.state.rear_y[who] + distance * np.cos(bearing)
