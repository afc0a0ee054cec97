"""Figures of a long ride's samples and bag: memory, lost steps, drift, proof."""

from __future__ import annotations

import gc
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from bicycle_msgs.msg import GoalStatus
from numpy.typing import NDArray

from bicycle_bag.columns import load_topics
from bicycle_bag.metadata import read
from bicycle_bag.reader import BagReader
from bicycle_common.nodes.topics import GOAL_STATUS, STATE, TIMING
from bicycle_sim.plants.choi.parameters import Constants
from bicycle_tools.nodes import ride_recording, verify_states

DT = Constants().time_step
SETTLED = 0.1
"""Share of the run after which memory should have stopped growing."""
OUTCOMES = ("REACHED", "MISSED", "GIVEN_UP", "FALLEN")


def growth(samples: list[dict[str, Any]], name: str) -> dict[str, Any]:
    """Return the trend of one process's memory after it had settled."""
    kept = [sample for sample in samples if sample["step"] >= SETTLED * samples[-1]["step"]]
    hours = np.array([sample["step"] for sample in kept]) * DT / 3600.0
    rss = np.array([sample[name]["rss_kib"] for sample in kept], dtype=float)
    half = hours >= hours.mean()
    return {
        "rss_mib": [round(rss[0] / 1024, 2), round(rss[-1] / 1024, 2)],
        "rss_mib_largest": round(rss.max() / 1024, 2),
        "growth_kib_per_simulated_hour": round(slope(hours, rss), 1),
        "growth_in_the_second_half": round(slope(hours[half], rss[half]), 1),
        "files": [kept[0][name]["files"], kept[-1][name]["files"]],
        "threads": [kept[0][name]["threads"], kept[-1][name]["threads"]],
    }


def slope(hours: NDArray[np.float64], rss: NDArray[np.float64]) -> float:
    """KiB per hour, by least squares."""
    return float(np.polyfit(hours, rss, 1)[0]) if np.ptp(hours) > 0.0 else float("nan")


def bag_figures(bag: Path, steps_again: int) -> dict[str, Any]:
    """Every step of the ride looked up, and so many of the last ones computed again."""
    states, timing, goals = columns(bag)
    steps = np.column_stack((states["episode"], states["step"])).astype(np.int64)
    known = np.unique(steps, axis=0)
    same = np.diff(known[:, 0]) == 0
    last = known[np.append(~same, True)]
    return {
        "steps": int(last[:, 1].sum()),
        "simulated_hours": round(float(last[:, 1].sum()) * DT / 3600.0, 3),
        "states_recorded": len(known),
        "states_missing": int(known[0, 1] + (np.diff(known[:, 1])[same] - 1).sum()),
        "messages_lost_by_the_recorders_count": read(bag).custom_data.get("lost_messages", ""),
        "bag_mib": round(sum(file.stat().st_size for file in bag.iterdir()) / 2**20, 1),
        "verified": verified(bag, steps_again),
        "goals": {
            name.lower(): int((goals["status"] == getattr(GoalStatus, name)).sum())
            for name in OUTCOMES
        },
        **loop_figures(timing),
    }


def columns(bag: Path) -> list[dict[str, NDArray[Any]]]:
    """States, timing and the goals' statuses."""
    topics = [f"/{topic.name}" for topic in (STATE, TIMING, GOAL_STATUS)]
    loaded = load_topics(BagReader(bag), topics)
    return [loaded[topic] for topic in topics]


def loop_figures(timing: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Drift of the simulated time against the simulator's steady clock; nothing in lock-step."""
    if not np.isfinite(timing["lateness"]).any():
        return {}
    order = np.lexsort((timing["step"], timing["episode"]))
    period, lateness, dropped = (
        timing[name][order] for name in ("period", "lateness", "dropped_steps")
    )
    result = np.arange(1, len(order)) + dropped[1:] - float(dropped[0])
    drift = np.cumsum(period[1:]) - result * DT
    lateness = lateness[np.isfinite(lateness)]
    return {
        "late_steps": int(timing["late_steps"].max()),
        "dropped_steps": int(dropped.max()),
        "drift_ms": {
            "at_the_end": round(1e3 * float(drift[-1]), 3),
            "largest": round(1e3 * float(np.abs(drift).max()), 3),
        },
        "lateness_ms": {
            label: round(1e3 * float(np.quantile(lateness, share)), 3)
            for label, share in (("p50", 0.5), ("p99", 0.99), ("largest", 1.0))
        },
    }


def verified(bag: Path, steps: int) -> str:
    """Return the verdict of `replay.sh --verify` on its last steps."""
    recording = ride_recording.read(bag)
    recording.states = recording.states[-steps - 1 :]
    gc.collect()
    gc.freeze()  # else the millions of commands are searched again and again
    return str(deque(verify_states.verify(recording), maxlen=1).pop())
