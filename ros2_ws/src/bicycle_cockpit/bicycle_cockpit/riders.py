"""Displayed names of policies, and their colours."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from bicycle_controller.control.lqr import TUNED, tuned, tuning_id
from bicycle_controller.policy.policy import load_policy, shipped_policies
from bicycle_sim.plants.base import Plant


def shipped_names() -> dict[str, str]:
    """Return the names of the shipped policies by their ids."""
    return {load_policy(name).policy_id: name for name in shipped_policies()}


def lqr_names(plant: Plant[Any]) -> dict[str, str]:
    """Return the names of the LQR's tunings by their ids, which differ with the bicycle."""
    return {tuning_id(tuned(name, plant), plant): name for name in TUNED}


@dataclass(frozen=True)
class Rider:
    """A policy as displayed by the pages."""

    policy: str
    """Its id."""
    name: str
    """Displayed name."""
    colour: str
    """Key in the palette: the name if that identifies the policy, else the id."""


def rider(policy: str, names: Mapping[str, str]) -> Rider:
    """Return a policy by its id.

    Args:
        policy: the id.
        names: displayed names of policies, by their ids.
    """
    if policy in names:
        return Rider(policy, names[policy], names[policy])
    word, at, _ = policy.partition("@")
    return Rider(policy, word if at or not policy.startswith("lqr-") else "lqr", policy)


class Palette:
    """A number for each policy, which is its colour on every page and in every bag.

    Shipped policies and the LQR's tunings have fixed numbers; others get the next ones in order
    of appearance. Thread-safe.
    """

    def __init__(self) -> None:
        fixed = [*shipped_policies(), *TUNED]
        self._lock = threading.Lock()
        self._slots = {name: slot for slot, name in enumerate(fixed)}

    def add(self, keys: Iterable[str]) -> bool:
        """Assign numbers to new keys; return True if there were any."""
        with self._lock:
            new = [key for key in dict.fromkeys(keys) if key and key not in self._slots]
            for key in new:
                self._slots[key] = len(self._slots)
        return bool(new)

    def message(self) -> dict[str, Any]:
        """Return the palette, for the pages."""
        with self._lock:
            return {"type": "palette", "slots": dict(self._slots)}
