"""Displayed names of policies, and their colours."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from bicycle_controller.control.lqr import TUNED, tuned, tuning_id
from bicycle_controller.policy.policy import KEPT, load_policy, shipped_policies
from bicycle_sim.plants.base import Plant


def shipped_names() -> dict[str, str]:
    """Return the names of the shipped policies by their ids."""
    return {load_policy(name).policy_id: name for name in shipped_policies()}


def lqr_names(plant: Plant[Any]) -> dict[str, str]:
    """Return the names of the LQR's tunings by their ids, which differ with the bicycle."""
    return {tuning_id(tuned(name, plant), plant): name for name in TUNED}


NETWORK = "a neural network"
LINEAR = "a linear controller"
LABELS = {
    "fixed-speed": ("DDPG actor", NETWORK),
    "small-displacement": ("DDPG actor, body ±2 cm", NETWORK),
    "learned-speed": ("DDPG actor with pedals", NETWORK),
    "naf": ("NAF actor", NETWORK),
    "ppo": ("PPO actor", NETWORK),
    "sure-fixed-speed": ("Sure DDPG actor", NETWORK),
    "any-bicycle": ("Actor for any bicycle", NETWORK),
    "sure-any-bicycle": ("Surer actor for any bicycle", NETWORK),
    "lqr": ("LQR", LINEAR),
    "lqr-displacement": ("LQR, body ±2 cm", LINEAR),
    "lqr-pedal": ("LQR with pedals", LINEAR),
    "lqr-displacement-pedal": ("LQR with pedals, body ±2 cm", LINEAR),
    "lqr-20cm": ("LQR, body ±20 cm", LINEAR),
}
"""Labels for people of shipped policies and tunings, with their kinds."""


FOLLOWERS = {"follow": "Path follower", "stanley": "Stanley path follower"}
"""Labels of what follows paths, by the first word of its id."""


def label(name: str) -> str:
    """Return the label of a policy's name, for people."""
    if name in LABELS:
        return LABELS[name][0]
    run, kept, updates = name.rpartition(f"/{KEPT}/")
    if kept and updates.isdecimal():
        return f"{run} after {int(updates):,} updates"
    return name


@dataclass(frozen=True)
class ListedPolicy:
    """A policy as displayed by the pages."""

    policy: str
    """Policy's id."""
    name: str
    """Policy's name on the command line, or the name in its id."""
    colour: str
    """Key in the palette: the name if that identifies the policy, else the id."""
    label: str
    """Label for people."""
    kind: str
    """Kind, such as a neural network; empty if unknown."""


def rider(policy: str, names: Mapping[str, str]) -> ListedPolicy:
    """Return a policy by its id.

    Args:
        policy: the id.
        names: displayed names of policies, by their ids.
    """
    if policy in names:
        name = names[policy]
        kind = NETWORK if "@" in policy else ""
        return ListedPolicy(policy, name, name, *LABELS.get(name, (label(name), kind)))
    word, at, _ = policy.partition("@")
    family = policy.partition("-")[0] if not at else ""
    if family in FOLLOWERS:
        return ListedPolicy(policy, family, policy, FOLLOWERS[family], LINEAR)
    linear = not at and policy.startswith("lqr-")
    if linear:
        return ListedPolicy(policy, "lqr", policy, LABELS["lqr"][0], LINEAR)
    return ListedPolicy(policy, word, policy, word, NETWORK if at else "")


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
