"""Bicycles by name, and yours from a YAML file.

A file has `bicycle` with the 25 parameters, or `measured` with what a tape measure and a scale
give; beside it, if need be, a rider and the other parts of `Parameters`. docs/bicycles.md has an
example of each.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bicycle_common.named_files import NamedFiles, parsed
from bicycle_common.validation import nearest, require
from bicycle_sim.plants.whipple import measure
from bicycle_sim.plants.whipple.measure import RigidRider, TapeReadings
from bicycle_sim.plants.whipple.parameters import Bicycle, Parameters
from bicycle_sim.plants.whipple.plain_parameters import PARTS, make

TEXTS = ("name", "about", "source", "licence")
SETTINGS = ("delay", "time_step", "substeps")
KEYS = (*TEXTS, "measured", "rigid_rider", "standard_deviation", *PARTS, *SETTINGS)
"""Keys that a bicycle's file may have."""


@dataclass(frozen=True)
class Described:
    """A bicycle and what is known about its numbers."""

    parameters: Parameters
    name: str
    about: str = ""
    source: str = ""
    licence: str = ""
    estimated: tuple[str, ...] = ()
    """One line for each parameter that was estimated instead of measured."""
    standard_deviation: dict[str, float] = field(default_factory=dict)
    """Standard deviations of the measured parameters, where known."""


FILES = NamedFiles("bicycle_sim.plants.whipple", "bicycles", "bicycle")


def names() -> list[str]:
    """Return the bicycles that come with the package."""
    return FILES.names()


def load(name_or_file: str | Path) -> Described:
    """Return the bicycle of a name, or of a YAML file.

    Raises:
        ValueError: when there is none, or its file has an unknown key or a value that makes no
            sense; one line that names it.
    """
    return read(*FILES.find(name_or_file))


def read(text: str, name: str, place: str) -> Described:
    """Return the bicycle that YAML describes.

    Args:
        text: the YAML.
        name: its name, unless the text has one.
        place: where the text is from, for errors.

    Raises:
        ValueError: on what is not such YAML; one line that names the place and the key.
    """
    data = parsed(text, place)
    try:
        return _described(data, name)
    except ValueError as error:
        raise ValueError(f"{place}: {error}") from error
    except ArithmeticError:
        raise ValueError(f"{place}: its numbers are too large or too small") from None


def _described(data: Any, name: str) -> Described:
    require(isinstance(data, dict), "a bicycle must be a mapping of names to values")
    for key in data:
        require(key in KEYS, f"a bicycle has no {key!r}{nearest(str(key), KEYS)}")
    for key in TEXTS:
        require(isinstance(data.get(key, ""), str), f"{key} must be a text")
    both = [key for key in ("bicycle", "measured") if key in data]
    require(
        len(both) == 1,
        "give either 'bicycle' with the 25 parameters or 'measured' with what you measured",
    )
    estimated: list[str] = []
    if "measured" in data:
        bicycle, estimated = measure.bicycle(make(TapeReadings, data["measured"]))
    else:
        bicycle = make(Bicycle, data["bicycle"])
    if "rigid_rider" in data:
        bicycle = measure.with_rider(bicycle, make(RigidRider, data["rigid_rider"]))
    parts: dict[str, Any] = {
        key: make(kind, data[key])
        for key, kind in PARTS.items()
        if key in data and key != "bicycle"
    }
    settings = {key: data[key] for key in SETTINGS if key in data}
    deviation = data.get("standard_deviation", {})
    require(isinstance(deviation, dict), "standard_deviation must be a mapping")
    for key, value in deviation.items():
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        require(number, f"standard_deviation: {key} is {str(value)[:40]!r}, not a number")
    shown = data.get("name", name)
    require(shown.isprintable(), f"name {shown[:40]!r} must be one line of plain text")
    return Described(
        parameters=Parameters(bicycle=bicycle, name=shown, **parts, **settings),
        name=shown,
        about=data.get("about", ""),
        source=data.get("source", ""),
        licence=data.get("licence", ""),
        estimated=tuple(estimated),
        standard_deviation={key: float(value) for key, value in deviation.items()},
    )
