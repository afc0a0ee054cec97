"""Conditions of a ride that a page may choose, and the nodes' parameters that make it so."""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from bicycle_cockpit import setup_labels
from bicycle_common.types import FASTEST_START
from bicycle_common.validation import nearest
from bicycle_controller.control import courses
from bicycle_sim.plants import registry
from bicycle_sim.sensors import settings as sensors
from bicycle_sim.task.scenario import SCENARIOS

PLANTS = {name: kind.about for name, kind in registry.PLANTS.items()}
"""Labels for people."""
WITH_NOISE = tuple(n for n, kind in registry.PLANTS.items() if kind.takes_displacement_noise)
"""Plants that take noise on the displacement."""
MOST_NOISE = 0.2
"""Largest half width of the noise on the displacement (m)."""
RATES = (0.05, 10.0)
"""Bounds of the simulated seconds in a second."""


@functools.cache
def _bicycles() -> dict[str, str]:
    return registry.bicycles()


@dataclass(frozen=True)
class RideSetup:
    """A ride's conditions."""

    scenario: str = "random-start-random-goal"
    plant: str = registry.default().name
    bicycle: str = ""
    """Bicycle's name, of a plant of measured bicycles; empty for its default."""
    sensors: str = ""
    """Preset of the sensors whose estimate the controller sees; empty shows it the truth."""
    speed: float = -1.0
    """m/s at the start; negative is the scenario's."""
    noise: float = 0.0
    """m, half width of uniform noise on the displacement; of WITH_NOISE alone."""
    rate: float = 1.0
    """Simulated seconds in a second."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ValueError: on one that is not known or out of range, in one line.
        """
        _one_of("scenario", self.scenario, SCENARIOS)
        _one_of("plant", self.plant, PLANTS)
        _one_of("bicycle", self.bicycle, ("", *_bicycles()))
        _one_of("sensors", self.sensors, ("", *sensors.names()))
        _within("speed", self.speed, -1.0, FASTEST_START, "m/s")
        _within("noise", self.noise, 0.0, MOST_NOISE, "m")
        _within("rate", self.rate, *RATES, "simulated seconds in a second")
        label = PLANTS[self.plant]
        if self.bicycle and not registry.takes_bicycle(self.plant):
            raise ValueError(f"{label} is not {self.bicycle}: choose another model")
        if self.noise and self.plant not in WITH_NOISE:
            only = " and ".join(PLANTS[name] for name in WITH_NOISE)
            raise ValueError(f"only {only} has noise on the displacement")

    def changed(self, values: Mapping[str, Any]) -> RideSetup:
        """Return the conditions with other values.

        Raises:
            ValueError: on an unknown name or a bad value.
        """
        unknown = sorted(set(values) - set(asdict(self)))
        if unknown:
            raise ValueError(f"a ride has no {unknown[0]!r}")
        return replace(self, **values)

    @property
    def parameters(self) -> dict[str, str]:
        """Return values of the nodes' parameters by `NODE.name`."""
        return {
            "simulator.scenario": self.scenario,
            "simulator.plant": self.plant,
            "simulator.bicycle": self.bicycle or "''",
            "simulator.sensors": self.sensors or "''",
            # A whole number without a point would be taken for an integer.
            "simulator.start_speed": repr(float(self.speed)),
            "simulator.displacement_noise": repr(float(self.noise)),
            "simulator.real_time_factor": repr(float(self.rate)),
            "controller.state": "estimated" if self.sensors else "truth",
            "controller.sensors": self.sensors or "mpu6050",
        }


NAMES = {
    "simulator.scenario": "scenario",
    "simulator.plant": "plant",
    "simulator.bicycle": "bicycle",
    "simulator.sensors": "sensors",
    "simulator.start_speed": "speed",
    "simulator.displacement_noise": "noise",
    "simulator.real_time_factor": "rate",
}
"""Fields of `RideSetup` by the parameter that sets them."""


def of_parameters(words: Iterable[str], told: Mapping[str, Any] | None = None) -> RideSetup:
    """Return the conditions of a ride, as far as pages know them.

    A value that pages do not offer, such as a bicycle's file, stays out: the pages show the
    default, and leave the parameter alone unless another value is chosen.

    Args:
        words: `NODE.name:=value` that the ride was started with.
        told: values by `NODE.name` that the nodes say they have; words win over them.
    """
    setup = RideSetup()
    values = _values(words, told)
    for name, field in NAMES.items():  # the plant before its bicycle
        if name in values:
            with contextlib.suppress(ValueError):
                kind = type(getattr(setup, field))
                setup = setup.changed({field: kind(values[name])})
    return setup


def own_bicycle(words: Iterable[str], told: Mapping[str, Any] | None = None) -> str:
    """Return the bicycle's file of a ride, which pages do not offer; empty without one."""
    values = _values(words, told)
    name = values.get("simulator.bicycle", "")
    rides = values.get("simulator.plant", RideSetup.plant) in registry.with_bicycles()
    return name if rides and name not in ("", *_bicycles()) else ""


def _values(words: Iterable[str], told: Mapping[str, Any] | None) -> dict[str, str]:
    given = dict(word.split(":=", 1) for word in words)
    found = {name: str(value) for name, value in (told or {}).items()}
    return found | {name: value.strip("'\"") for name, value in given.items()}


def merged(words: Iterable[str], setup: RideSetup, before: RideSetup) -> tuple[str, ...]:
    """Return the parameters of a ride under other conditions.

    Args:
        words: `NODE.name:=value` of the ride before.
        setup: the conditions.
        before: those of `words`; a parameter that is the same in both is left as it is.
    """
    values = dict(word.split(":=", 1) for word in words)
    old = before.parameters
    values |= {name: v for name, v in setup.parameters.items() if v != old[name]}
    return tuple(f"{name}:={value}" for name, value in values.items())


def with_policy(words: Iterable[str], path: str) -> tuple[str, ...]:
    """Return the parameters with another policy; an empty path leaves them as they are."""
    kept = tuple(word for word in words if not (path and word.startswith("controller.policy:=")))
    return (*kept, f"controller.policy:={path}") if path else kept


def command(setup: RideSetup, before: RideSetup) -> str:
    """Return the command that begins such a ride, for a cockpit that did not start the ride."""
    words = merged((), setup, before)
    nodes = {"simulator": "sim.sh", "controller": "controller.sh"}
    lines = []
    for node, script in nodes.items():
        own = [word.removeprefix(f"{node}.") for word in words if word.startswith(f"{node}.")]
        if own:
            lines.append(" ".join([f"./ros2_ws/{script}", *own]))
    return " and ".join(lines)


def choices() -> dict[str, Any]:
    """Return what a page can choose from: names, labels and, where there is one, a description."""
    return {
        "scenarios": [[name, setup_labels.of_scenario(one)] for name, one in SCENARIOS.items()],
        "plants": [[name, setup_labels.PLANTS.get(name, about)] for name, about in PLANTS.items()],
        "with_bicycles": registry.with_bicycles(),
        "with_noise": WITH_NOISE,
        "bicycles": [
            [name, setup_labels.BICYCLES.get(name, setup_labels.in_words(name)), about]
            for name, about in _bicycles().items()
        ],
        "sensors": [
            [name, setup_labels.SENSORS.get(name, setup_labels.in_words(name))]
            for name in sensors.names()
        ],
        "courses": [[name, setup_labels.in_words(name)] for name in courses.names()],
        "fastest": FASTEST_START,
    }


def _one_of(name: str, value: object, known: Iterable[str]) -> None:
    listed = list(known)
    if value not in listed:
        hint = nearest(str(value), listed)
        raise ValueError(f"{name} is {str(value)[:60]!r}{hint}, which is not offered")


def _within(name: str, value: float, low: float, high: float, unit: str) -> None:
    if not (math.isfinite(value) and low <= value <= high):
        raise ValueError(f"{name} is {value:g}, not {low:g} to {high:g} {unit}")
