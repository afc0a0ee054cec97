"""Scenario and physics of an episode, read from its message."""

from __future__ import annotations

from typing import Any

from bicycle_msgs.msg import EpisodeInfo

from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant
from bicycle_sim.task.scenario import Scenario


def to_setting(message: EpisodeInfo) -> tuple[Scenario, Plant[Any]]:
    """Scenario and plant of an episode.

    Raises:
        ValueError: if the message was not written by this simulator.
    """
    return Scenario.from_json(message.scenario), registry.from_json(message.physics)
