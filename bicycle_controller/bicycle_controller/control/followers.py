"""Followers by name."""

from __future__ import annotations

from typing import Any

import numpy as np

from bicycle_common.validation import nearest
from bicycle_controller.control.follow_gains import FollowConfig
from bicycle_controller.control.path_follower import PathFollower, StanleyFollower
from bicycle_sim.plants.base import Plant

FOLLOWERS: dict[str, type[PathFollower]] = {"preview": PathFollower, "stanley": StanleyFollower}
"""LQR with preview, and the baseline."""


def make(
    name: str, plant: Plant[Any], torque_limit: float = 2.0, pedal_limit: float = 100.0
) -> PathFollower:
    """Return the follower of a name for a bicycle.

    Args:
        name: one of FOLLOWERS.
        plant: the bicycle.
        torque_limit: N m, largest |T|.
        pedal_limit: N, largest |F|.

    Raises:
        ValueError: on an unknown name; names the nearest one.
    """
    if name not in FOLLOWERS:
        hint = nearest(name, FOLLOWERS)
        raise ValueError(f"unknown follower {name!r}{hint}; known: {', '.join(FOLLOWERS)}")
    config = FollowConfig(torque_limit=torque_limit, pedal_limit=pedal_limit)
    return FOLLOWERS[name](plant, config)


def tightest(follower: PathFollower, slowest: float = 2.0) -> float:
    """Return the radius of the sharpest turn that a path may ask for, m.

    Args:
        follower: of the bicycle.
        slowest: m/s, lowest speed in turns; the easiest speed above it counts.
    """
    speeds = np.linspace(slowest, max(slowest, 4.0), 33)
    return float(1.0 / follower.sharpest(speeds).max())
