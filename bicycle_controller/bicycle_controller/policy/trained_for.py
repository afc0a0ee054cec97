"""Comparison of the ridden bicycle with the one that a controller was trained or designed for."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from bicycle_common.observation import ACTION_FIELDS
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant
from bicycle_sim.task.scenario import Scenario

if TYPE_CHECKING:
    from bicycle_controller.control.controller import Controller

UNLIKE = "rides unlike it was trained"
"""Key of the warning in the controller's diagnostics; its value is "no" without a difference."""
TOO = "physics_too"
"""Key in the record of a training: JSON of the plant that every second bicycle of it had."""
NOISE = ("displacement_noise",)
"""Fields of a plant that are disturbances: a difference in them does not make another bicycle."""
SPEED_TOLERANCE = 0.05
"""Relative difference of speeds that count as equal."""


def differences(trained: Plant[Any], ridden: Plant[Any]) -> list[str]:
    """Return the differences of two bicycles, one line each, such as `wheelbase 1.2, not 1.11`.

    Args:
        trained: bicycle that the controller knows.
        ridden: bicycle that it rides; named first.
    """
    old, new = (json.loads(plant.to_json()) for plant in (trained, ridden))
    for name in ("plant", "name"):
        if old.get(name) != new.get(name):
            return [f"{name} {new.get(name)}, not {old.get(name)}"]
    return list(_differences(old, new))


def _differences(trained: dict[str, Any], ridden: dict[str, Any]) -> Iterator[str]:
    for name in trained:
        old, new = trained[name], ridden[name]
        if name in NOISE or old == new:
            continue
        if isinstance(old, dict) and isinstance(new, dict):
            yield from _differences(old, new)
        else:
            yield f"{name} {_shown(new)}, not {_shown(old)}"


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return "another one"
    return f"{value:g}" if isinstance(value, float) else str(value).lower()


def rides_any(controller: Controller, plant: Plant[Any]) -> bool:
    """Return True for an actor that was trained to ride any bicycle of that kind of plant."""
    info = getattr(controller, "info", None)
    return info is not None and plant.name in info.plants


def unlike_training(
    controller: Controller, plant: Plant[Any], scenario: Scenario | None = None
) -> list[str]:
    """Return the differences of a ride from those that a controller was trained or designed for.

    Args:
        controller: any; one that does not say what it was made for differs in nothing.
        plant: the bicycle that is ridden.
        scenario: of the ride; its start speed is looked at.
    """
    info = getattr(controller, "info", None)
    known = getattr(controller if info is None else info, "plant", None)
    found = [] if known is None or rides_any(controller, plant) else differences(known, plant)
    if found and info is not None and _trained_too(info.trained, plant):
        found = []
    if info is not None and scenario is not None:
        low, high = info.speeds or _speeds(info.scenario)
        slack = SPEED_TOLERANCE * info.scenario.start_speed
        if not low - slack <= scenario.start_speed <= high + slack:
            range_ = f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}"
            found.append(f"start speed {scenario.start_speed:.3g} m/s, not {range_}")
    return found


def held_back(controller: Controller, plant: Plant[Any], scenario: Scenario) -> list[str]:
    """Return the actions of which a ride allows less than a policy was trained with.

    Args:
        controller: any; one that does not say what it was made for is not held back.
        plant: the bicycle that is ridden; actions that it does not have are its own difference.
        scenario: of the ride, whose limits are looked at.
    """
    info = getattr(controller, "info", None)
    if info is None or rides_any(controller, plant):
        return []
    return [
        f"{name} limited to {allowed:g} {unit}, not {used:g}"
        for name, unit, allowed, used in zip(
            ACTION_FIELDS,
            ("N m", "m", "N"),
            scenario.action_limits,
            info.action_limits,
            strict=True,
        )
        if name in plant.input_names and allowed < used * (1.0 - 1e-9)
    ]


def _trained_too(trained: dict[str, Any], plant: Plant[Any]) -> bool:
    """Return True if every second bicycle of the training was this one."""
    try:
        return not differences(registry.from_dict(trained[TOO]), plant)
    except (KeyError, ValueError, TypeError):
        return False


def _speeds(trained: Scenario) -> tuple[float, float]:
    """Return the least and largest speed of a scenario, m/s."""
    if trained.pedal_limit > 0 and trained.speed_limits is not None:
        return trained.speed_limits
    return trained.start_speed, trained.start_speed


def warning(policy_id: str, found: list[str]) -> str:
    """Return one line about these differences, with the remedy; empty without any."""
    if not found:
        return ""
    return (
        f"policy {policy_id} was made for another ride ({'; '.join(found)}): it may fall, and "
        "what is known of it does not hold here; train one for this, or ride what it was made for"
    )
