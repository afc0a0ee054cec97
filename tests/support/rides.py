"""A ride made by hand: 2 m/s along +x, one step every 25 ms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from bicycle_tools.ride_log import Columns, RideLog, distinct

PERIOD = 0.025
SPEED = 2.0


def states(count: int, episode: int = 1, fall_at: int | None = None) -> dict[str, Any]:
    """Return `count` states from step 0; fallen from `fall_at` on."""
    step = np.arange(count)
    x = SPEED * PERIOD * step
    zero = np.zeros(count)
    return {
        "episode": np.full(count, episode, np.uint32),
        "step": step.astype(np.uint64),
        "header.stamp": PERIOD * step,
        "rear_contact.x": x,
        "rear_contact.y": zero,
        "lean_angle": np.where(step % 2 == 0, 0.1, -0.2),
        "steer_angle": zero,
        "heading": zero,
        "speed": np.full(count, SPEED),
        "fallen": step >= (count if fall_at is None else fall_at),
        "goal.x": np.full(count, 10.0),
        "goal.y": zero,
        "goal_distance": 10.0 - x,
        "command_source": np.where(step == 0, 0, 1).astype(np.uint8),
        "command_step": step.astype(np.int64) - 1,
        "applied.torque": np.where(step == 0, np.nan, 1.0),
        "applied.displacement": np.where(step == 0, np.nan, 0.1),
    }


def commands(count: int) -> dict[str, Any]:
    """Return the commands that answer the first `count` states."""
    return {
        "episode": np.ones(count, np.uint32),
        "step": np.arange(count, dtype=np.uint64),
        "torque": np.linspace(-2.0, 2.0, count),
        "displacement": np.full(count, 0.1),
        "policy": np.array(["lqr-1"] * count, dtype=object),
    }


def timing(period: list[float], late: list[int] | None = None) -> dict[str, Any]:
    """Return one row for each period, s; NaN for the first step after a stop."""
    count = len(period)
    return {
        "period": np.array(period),
        "lateness": np.zeros(count),
        "latency": np.full(count, 0.002),
        "late_steps": np.array(late or [0] * count, np.uint64),
        "dropped_steps": np.zeros(count, np.uint64),
    }


def statuses(*rows: tuple[int, int, tuple[float, float], float, float]) -> dict[str, Any]:
    """Return rows of (goal id, status, position, distance, path length)."""
    return {
        "goal_id": np.array([row[0] for row in rows], np.uint32),
        "status": np.array([row[1] for row in rows], np.uint8),
        "position.x": np.array([row[2][0] for row in rows]),
        "position.y": np.array([row[2][1] for row in rows]),
        "distance": np.array([row[3] for row in rows]),
        "path_length": np.array([row[4] for row in rows]),
        "elapsed": np.zeros(len(rows)),
    }


def joined(*parts: Columns) -> dict[str, Any]:
    """Columns one after the other."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def ride(
    recorded: Columns,
    goals: Columns | None = None,
    times: Columns | None = None,
    given: Columns | None = None,
) -> RideLog:
    """Return a log as `read_ride` makes it."""
    kept, segment = distinct(recorded)
    return RideLog(
        path=Path("made-up"),
        states=kept,
        commands=given or {},
        timing=times or {},
        statuses=goals or {},
        episodes={},
        segment=segment,
        message_count=123,
    )
