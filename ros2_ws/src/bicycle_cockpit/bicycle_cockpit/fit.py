"""Compatibility of a controller with the ride: its actions, and the bicycle of its training."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bicycle_cockpit.policy_catalogue import PolicyCatalogue
from bicycle_cockpit.ride_state import RideState
from bicycle_controller.control.lqr import TUNED, tuned
from bicycle_controller.policy.policy import PolicyError, load_controller
from bicycle_controller.policy.trained_for import rides_any, unlike_training
from bicycle_sim.plants.base import Plant
from bicycle_sim.task.scenario import Scenario

ACTIONS = (("torque", 1.0, "N m"), ("displacement", 100.0, "cm"), ("pedal force", 1.0, "N"))
"""Name, factor to the displayed unit, and unit of each action."""


def misfit(path: str, plant: Plant[Any], scenario: Scenario) -> str:
    """Return why a controller does not suit a ride; empty if it does.

    Args:
        path: a controller's name or its file, as `bicycle/load_policy` takes it.
        plant: the bicycle.
        scenario: the ride's scenario.
    """
    unlike: list[str] = []
    if path in TUNED:  # designed for each bicycle
        tuning = tuned(path, plant)
        displacement = tuning.displacement_limit if tuning.use_displacement else 0.0
        pedal = tuning.pedal_limit if tuning.use_pedal else 0.0
        wanted: Sequence[float] = (tuning.torque_limit, displacement, pedal)
    else:
        try:
            policy = load_controller(path, plant, may_import=False)
        except PolicyError:
            return ""  # the controller reports the error
        info = getattr(policy, "info", None)
        wanted = () if info is None or rides_any(policy, plant) else info.action_limits
        unlike = unlike_training(policy, plant, scenario)
    reasons = [
        f"it uses {factor * most:g} {unit} of {name} and {factor * limit:g} {unit} are allowed"
        for (name, factor, unit), most, limit in zip(
            ACTIONS, wanted, scenario.action_limits, strict=False
        )
        if most > limit * (1.0 + 1e-9)
    ]
    if unlike:
        reasons.append(f"it was made for another ride ({', '.join(unlike)})")
    return "; ".join(reasons)


class Suits:
    """Compatibility of the active controller with the current ride; used in one thread.

    Args:
        choices: path of its file.
        live: the active controller and the ride.
    """

    def __init__(self, choices: PolicyCatalogue, live: RideState) -> None:
        self._choices, self._live = choices, live
        self._asked: object = None
        self._found = ""

    def misfit(self) -> str:
        """Return the reason why not; empty if it suits, or if that is unknown."""
        live = self._live
        asked = (live.who.chosen, live.setting)
        if asked != self._asked:
            self._asked, self._found = asked, self._look()
        # The controller itself judges one that is not in the catalogue.
        return self._found or live.unlike

    def _look(self) -> str:
        name = self._live.names.get(self._live.who.chosen, "")
        if self._live.setting is None:
            return ""
        try:
            return misfit(self._choices.path(name), *self._live.setting)
        except KeyError:
            return ""
