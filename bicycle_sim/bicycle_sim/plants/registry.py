"""Registry of plants, by their JSON and by the names that users type."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from bicycle_common.validation import nearest
from bicycle_sim.plants.base import Plant
from bicycle_sim.plants.choi.parameters import Physics
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.plants.whipple import catalogue
from bicycle_sim.plants.whipple.plant import WhipplePlant

PLANTS: dict[str, Any] = {ChoiPlant.name: ChoiPlant, WhipplePlant.name: WhipplePlant}
"""Plants by the key `plant` of their JSON."""


def from_json(text: str) -> Plant[Any]:
    """Return the plant that `to_json` wrote; JSON without the key `plant` is the paper's bicycle.

    Raises:
        ValueError: on other text, or on an unknown plant, key or value.
    """
    data = json.loads(text)
    if not isinstance(data, dict):
        raise ValueError(f"a plant must be a mapping, not {type(data).__name__}")
    made: Plant[Any] = _kind(str(data.get("plant", ChoiPlant.name))).from_dict(data)
    return made


def named(plant: str, bicycle: str | Path | None = None, physics: str = "faithful") -> Plant[Any]:
    """Return the plant of a name, with the bicycle of a name or a YAML file.

    Args:
        plant: choi or whipple.
        bicycle: see `catalogue.load`; the benchmark by default. The paper's plant has its own.
        physics: faithful or corrected, of the paper's plant.

    Raises:
        ValueError: on an unknown name, with the nearest one.
    """
    kind = _kind(plant)
    if kind is WhipplePlant:
        found = catalogue.load("benchmark" if bicycle is None else bicycle)
        return WhipplePlant(found.parameters)
    if bicycle is not None:
        raise ValueError(f"the plant {plant} has no bicycles to choose from: leave it out")
    return ChoiPlant(Physics.named(physics))


def _kind(name: str) -> Any:
    if name not in PLANTS:
        hint = nearest(name, PLANTS)
        raise ValueError(f"unknown plant {name!r}{hint}; known: {', '.join(PLANTS)}")
    return PLANTS[name]
