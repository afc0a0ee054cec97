"""Registry of plants, by their JSON and by the names that users type."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from bicycle_common import json_input
from bicycle_common.validation import nearest, require
from bicycle_sim.plants.base import Plant
from bicycle_sim.plants.choi.parameters import Physics
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.plants.mujoco.plant import MujocoPlant
from bicycle_sim.plants.whipple import catalogue
from bicycle_sim.plants.whipple.plant import WhipplePlant

PLANTS: dict[str, Any] = {kind.name: kind for kind in (ChoiPlant, WhipplePlant, MujocoPlant)}
"""Plants by the key `plant` of their JSON."""


FIELDS: dict[str, tuple[Any, Any]] = {ChoiPlant.name: (Physics, ChoiPlant)}
"""Dataclass and class of each plant whose fields a configuration may change one by one. The
dataclass holds the fields and has `named`; the plant is made from one."""


def from_json(text: str) -> Plant[Any]:
    """Return the plant that `to_json` wrote; JSON without the key `plant` is the paper's bicycle.

    Raises:
        ValueError: on other text, or on an unknown plant, key or value.
    """
    return from_dict(json_input.parse(text))


def from_dict(data: Any) -> Plant[Any]:
    """Return the plant that plain data describe.

    Raises:
        ValueError: on data that is not such, an unknown plant, key or value.
    """
    if not isinstance(data, dict):
        raise ValueError(f"a plant must be a mapping, not {type(data).__name__}")
    plant: Plant[Any] = _kind(str(data.get("plant", ChoiPlant.name))).from_dict(data)
    return plant


def to_dict(plant: Plant[Any]) -> dict[str, Any]:
    """Return the plain data of a plant for `from_dict`; those of the default name no plant.

    So what is computed from them stays as it was before there were other plants.
    """
    data: dict[str, Any] = json_input.parse(plant.to_json())
    if data["plant"] == ChoiPlant.name:
        del data["plant"]
    return data


def named(
    plant: str | None = None,
    bicycle: str | Path | None = None,
    physics: str = "faithful",
    **options: Any,
) -> Plant[Any]:
    """Return the plant of a name, with the bicycle of a name or a YAML file.

    Args:
        plant: choi, whipple, or mujoco, which needs the package of that name; by default whipple
            if a bicycle is given, else choi.
        bicycle: see `catalogue.load`; the benchmark by default. The paper's plant has its own.
        physics: faithful or corrected, of the paper's plant.
        options: corrections of the paper's plant that are on besides, and its displacement noise.

    Raises:
        ValueError: on an unknown name, with the nearest one, or on what this plant has not.
    """
    if plant is None:
        plant = ChoiPlant.name if bicycle is None else WhipplePlant.name
    kind, on = _kind(plant), {n: v for n, v in options.items() if v}
    if kind.takes_bicycle:
        other = [*on, *(["physics"] if physics != "faithful" else [])]
        require(not other, f"the plant {plant} has no {', '.join(other)}: leave it out")
        found = catalogue.load("benchmark" if bicycle is None else bicycle)
        return kind(found.parameters)
    if bicycle is not None:
        raise ValueError(f"the plant {plant} has no bicycles to choose from: leave it out")
    return ChoiPlant(replace(Physics.named(physics), **on))


def takes_bicycle(plant: str) -> bool:
    """Return True if the plant of a name is one of measured bicycles.

    Raises:
        ValueError: on an unknown name, with the nearest one.
    """
    return bool(_kind(plant).takes_bicycle)


def with_bicycles() -> tuple[str, ...]:
    """Return the names of the plants of measured bicycles."""
    return tuple(name for name in PLANTS if takes_bicycle(name))


def bicycles() -> dict[str, str]:
    """Return a description of each measured bicycle, by name; for `with_bicycles`."""
    return {name: catalogue.load(name).about for name in catalogue.names()}


def default() -> Plant[Any]:
    """Return the paper's bicycle, faithful: the default plant."""
    return ChoiPlant()


def _kind(name: str) -> Any:
    if name not in PLANTS:
        hint = nearest(name, PLANTS)
        raise ValueError(f"unknown plant {name!r}{hint}; known: {', '.join(PLANTS)}")
    return PLANTS[name]
