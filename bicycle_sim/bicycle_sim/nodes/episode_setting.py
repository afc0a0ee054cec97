"""Scenario and physics of an episode, read from its message."""

from __future__ import annotations

from bicycle_msgs.msg import EpisodeInfo

from bicycle_sim.plants.choi.parameters import Physics
from bicycle_sim.task.scenario import Scenario


def to_setting(message: EpisodeInfo) -> tuple[Scenario, Physics]:
    """Return the scenario and physics of an episode.

    Raises:
        ValueError: if the message was not written by this simulator.
    """
    return Scenario.from_json(message.scenario), Physics.from_json(message.physics)
