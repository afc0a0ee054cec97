"""The made-up ride that the bag tests record: names, types and times."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bicycle_bag.metadata import BagMetadata
from bicycle_bag.qos import QosProfile

START_NS = 1_700_000_000_000_000_000
PERIOD_NS = 25_000_000
STATE = "/bicycle/state"
COMMAND = "/bicycle/command"
EPISODE = "/bicycle/episode"
TYPES = {STATE: "BicycleState", COMMAND: "BicycleCommand", EPISODE: "EpisodeInfo"}
LATCHED = QosProfile(durability="transient_local")

Message = tuple[str, bytes, int]
Ride = Callable[[int], list[Message]]
Serialise = Callable[[str, dict[str, Any]], bytes]
MakeBag = Callable[..., BagMetadata]
