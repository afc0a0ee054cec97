"""Whether a controller suits the ride: what it would use and may, and what it was made for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bicycle_cockpit.policy_catalogue import PolicyCatalogue
from bicycle_cockpit.ride_state import RideState
from bicycle_controller.control.lqr import TUNED
from bicycle_controller.policy.policy import PolicyError, load_policy
from bicycle_controller.policy.trained_for import unlike_training
from bicycle_sim.plants.base import Plant
from bicycle_sim.task.scenario import Scenario

ACTIONS = (("torque", 1.0, "N m"), ("displacement", 100.0, "cm"), ("pedal force", 1.0, "N"))
"""Name, factor for a person, and unit of each action."""


def misfit(path: str, plant: Plant[Any], scenario: Scenario) -> str:
    """Why a controller is not at home in a ride; empty where it is.

    Args:
        path: a controller's name or its file, as `bicycle/load_policy` takes it.
        plant: the bicycle.
        scenario: of the ride.
    """
    unlike: list[str] = []
    if path in TUNED:  # for every bicycle anew
        tuning = TUNED[path]
        displacement = tuning.displacement_limit if tuning.use_displacement else 0.0
        pedal = tuning.pedal_limit if tuning.use_pedal else 0.0
        wanted: Sequence[float] = (tuning.torque_limit, displacement, pedal)
    else:
        try:
            policy = load_policy(path)
        except PolicyError:
            return ""  # the controller says what is wrong with it
        wanted = policy.info.action_limits
        unlike = unlike_training(policy, plant, scenario)
    reasons = [
        f"it uses {factor * most:g} {unit} of {name} and {factor * limit:g} {unit} are allowed"
        for (name, factor, unit), most, limit in zip(
            ACTIONS, wanted, scenario.action_limits, strict=True
        )
        if most > limit * (1.0 + 1e-9)
    ]
    if unlike:
        reasons.append(f"it was made for another ride ({', '.join(unlike)})")
    return "; ".join(reasons)


class Suits:
    """Whether the controller in charge suits the present ride; belongs to the live ride's thread.

    Args:
        choices: where its file is.
        live: which one is in charge, and in what ride.
    """

    def __init__(self, choices: PolicyCatalogue, live: RideState) -> None:
        self._choices, self._live = choices, live
        self._asked: object = None
        self._found = ""

    def misfit(self) -> str:
        """Why not; empty where it does, or where that is not known."""
        live = self._live
        asked = (live.who.chosen, live.setting)
        if asked != self._asked:
            self._asked, self._found = asked, self._look()
        # One that is not offered here is judged by the controller alone.
        return self._found or live.unlike

    def _look(self) -> str:
        name = self._live.names.get(self._live.who.chosen, "")
        if self._live.setting is None:
            return ""
        try:
            return misfit(self._choices.path(name), *self._live.setting)
        except KeyError:
            return ""
