"""Followers by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from bicycle_common.validation import nearest
from bicycle_controller.control.follow_gains import FollowConfig
from bicycle_controller.control.learned_follower import LearnedFollower, Network
from bicycle_controller.control.path_follower import PathFollower, StanleyFollower
from bicycle_sim.plants.base import Plant

FOLLOWERS: dict[str, type[PathFollower]] = {
    "preview": PathFollower,
    "stanley": StanleyFollower,
    "learned": LearnedFollower,
}
"""LQR with preview, the baseline, and the shipped network."""
FILE = ".npz"
"""Suffix of a follower of one's own, by `bicycle train path-following`."""


def make(
    name: str, plant: Plant[Any], torque_limit: float = 2.0, pedal_limit: float = 100.0
) -> PathFollower:
    """Return the follower of a name for a bicycle.

    Args:
        name: one of FOLLOWERS, or the file of a learned one.
        plant: the bicycle.
        torque_limit: N m, largest |T|.
        pedal_limit: N, largest |F|.

    Raises:
        ValueError: on an unknown name, with the nearest one, or a file that will not do.
    """
    config = FollowConfig(torque_limit=torque_limit, pedal_limit=pedal_limit)
    if name.endswith(FILE):
        return LearnedFollower(plant, config, Network.load(Path(name)))
    if name not in FOLLOWERS:
        hint = nearest(name, FOLLOWERS)
        raise ValueError(f"unknown follower {name!r}{hint}; known: {', '.join(FOLLOWERS)}")
    return FOLLOWERS[name](plant, config)


def tightest(follower: PathFollower, slowest: float = 2.0) -> float:
    """Return the radius of the sharpest turn that a path may ask for, m.

    Args:
        follower: the bicycle's follower.
        slowest: m/s, lowest speed in turns; the easiest speed above it counts.
    """
    speeds = np.linspace(slowest, max(slowest, 4.0), 33)
    return float(1.0 / follower.sharpest(speeds).max())
