"""All that makes a controller, as JSON in the bag, so that its commands can be computed again."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from bicycle_common import json_input
from bicycle_controller.control.control_loop import ControlLoop
from bicycle_controller.control.controller import Controller
from bicycle_controller.control.goals import GoalTracker
from bicycle_controller.control.lqr import LqrController
from bicycle_controller.estimation.settings import ESTIMATOR
from bicycle_controller.nodes.controller_settings import ControllerSettings
from bicycle_controller.policy.policy import PolicyError, load_controller
from bicycle_sim.plants.base import Plant
from bicycle_sim.sensors import settings as sensor_settings
from bicycle_sim.sensors.settings import SensorSettings
from bicycle_sim.task.scenario import Scenario

NO_LIMITS = np.full(3, np.inf)


@dataclass(frozen=True)
class Setup:
    """One controller."""

    name: str
    """Controller's name, sent in every command."""
    settings: ControllerSettings
    sensors: SensorSettings | None
    """Sensors of its estimator; None if it sees the truth."""
    estimator: int = ESTIMATOR
    """Number of the estimator, see `estimation.settings`."""

    def to_json(self) -> str:
        """Return everything as JSON; floats keep every bit."""
        return json.dumps(
            {
                "version": 1,
                "name": self.name,
                "parameters": asdict(self.settings),
                "sensors": None if self.sensors is None else self.sensors.to_dict(),
                "estimator": self.estimator,
            }
        )

    @classmethod
    def from_json(cls, text: str) -> Setup:
        """Return what `to_json` wrote.

        Raises:
            ValueError: on other text.
        """
        try:
            data = json_input.parse(text)
            sensors = data["sensors"]
            return cls(
                str(data["name"]),
                ControllerSettings(**data["parameters"]),
                None if sensors is None else sensor_settings.from_dict(sensors),
                int(data.get("estimator", 1)),
            )
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"it is no controller's setup ({error})") from None


def limits_of(policy: Controller) -> np.ndarray:
    """Return (3,) the largest |T|, |d| and |F| that a policy may use; infinite if unknown."""
    info = getattr(policy, "info", None)
    known = getattr(policy if info is None else info, "action_limits", None)
    return NO_LIMITS if known is None else np.array(known, dtype=np.float64)


def designed(policy: Controller, plant: Plant[Any]) -> Controller:
    """Return the policy; an LQR for another kind of bicycle is designed for this one.

    Raises:
        ValueError, ArithmeticError, TypeError: if there is no LQR for it.
    """
    if not isinstance(policy, LqrController):
        return policy
    same_kind = policy.plant.name == plant.name
    if policy.plant == plant or (same_kind and plant.fits_named_tunings):
        return policy
    with np.errstate(all="ignore"):
        if policy.tuning:
            return LqrController.named(policy.tuning, plant)
        return LqrController(policy.config, plant)


def rebuilt(
    setup: Setup, plant: Plant[Any], scenario: Scenario, tracker: GoalTracker
) -> ControlLoop:
    """Return the loop as its node had it while it rode a bicycle.

    Args:
        setup: the node's setup.
        plant: the ridden bicycle.
        scenario: whose limits the commands had.
        tracker: of the goals.

    Raises:
        ValueError: if the policy cannot be loaded here, or does not suit the bicycle.
    """
    settings = setup.settings
    try:
        policy = designed(load_controller(settings.policy), plant)
        limits = np.minimum(limits_of(policy), scenario.action_limits)
        return ControlLoop(
            setup.name,
            policy,
            tracker,
            limits,
            settings.make_noise(),
            settings.make_fallback(limits, plant),
            settings.take_over,
            settings.make_safety(plant),
            plant,
        )
    except (PolicyError, ArithmeticError, TypeError) as error:
        raise ValueError(str(error)) from None
