"""The largest kick that a controller catches, on any bicycle at any speed.

A kick adds to the lean rate in an instant, as an elbow or a gust does. The bicycle rides straight
on, or along a circle: then the wanted heading turns at a steady rate, and the controller sees its
heading error alone, as always. A kick is caught if the bicycle is upright some seconds later and
neither its lean nor its steering was ever beyond a limit. The largest kick caught is the one below
which every kick is caught, for a larger one may be survived by luck.

The keys of the result, as `bicycle evaluate --kicks --json` prints them for every speed:

    speed                  m/s at which the ride begins; nothing holds it
    turn_radius            m of the circle
    straight               [to the left, to the right] deg/s, largest kicks caught
    turn                   [into the turn, out of it] deg/s, likewise
    caught                 deg/s, the smallest of the four
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bicycle_common.geometry import wrap_angle
from bicycle_common.observation import ACTION_FIELDS
from bicycle_common.validation import require
from bicycle_controller.control.riding import Riding
from bicycle_sim.plants import base
from bicycle_sim.plants.base import FALL_ANGLE, Plant

if TYPE_CHECKING:
    from bicycle_controller.control.controller import Controller

SPEEDS = (1.5, 2.0, 3.0, 4.0, 6.0)
"""Speeds at which kicks are tried by default, m/s."""


@dataclass(frozen=True)
class Trial:
    """Settings of trials with kicks.

    Raises:
        ValueError: on a number that is not above zero.
    """

    most: float = 300.0
    """deg/s, the largest kick that is tried."""
    coarse: float = 5.0
    """deg/s between the kicks that are tried first."""
    fine: float = 1.0
    """Step between the kicks tried between the last one caught and the first one not, deg/s."""
    before: float = 6.0
    """s of riding before the kick."""
    after: float = 6.0
    """s of riding after it."""
    lean: float = FALL_ANGLE
    """rad, largest lean of a bicycle that is upright."""
    steer: float = math.pi / 3
    """rad, largest steering."""
    turn_lean: float = 0.1
    """rad of lean in the turn."""
    turn_radius: float = 5.0
    """m, smallest radius of the turn."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            require(math.isfinite(value) and value > 0, f"{name} must be above zero, not {value}")

    def radius(self, speed: float) -> float:
        """Return the radius of the turn at a speed, m."""
        return max(self.turn_radius, speed * speed / (9.81 * math.tan(self.turn_lean)))


@dataclass(frozen=True)
class Kicks:
    """The largest kicks caught at one speed, deg/s."""

    speed: float
    """m/s."""
    turn_radius: float
    """m."""
    straight: tuple[float, float]
    """Largest kicks to the left and to the right."""
    turn: tuple[float, float]
    """Into the turn, out of it."""

    @property
    def caught(self) -> float:
        """The smallest of the four."""
        return min(*self.straight, *self.turn)

    def summary(self) -> dict[str, Any]:
        """Return the keys listed above, ready for JSON."""
        return {
            "speed": self.speed,
            "turn_radius": self.turn_radius,
            "straight": list(self.straight),
            "turn": list(self.turn),
            "caught": self.caught,
        }


def largest(
    controller: Controller,
    plant: Plant[Any],
    speed: float,
    limits: Sequence[float] | np.ndarray,
    trial: Trial | None = None,
) -> Kicks:
    """Return the largest kicks that a controller catches at one speed.

    Args:
        controller: chooses the actions; with its memory, if it has any.
        plant: bicycles that are alike, with delay, motor and friction.
        speed: m/s.
        limits: (3,) largest |T| in N m, |d| in m and |F| in N; what the plant has no use for is
            not used.
        trial: how kicks are tried.

    Raises:
        ValueError: if the plant's bicycles differ, or the speed is not above zero.
    """
    trial = trial or Trial()
    require(plant.count is None, "kicks are tried on one bicycle at a time")
    require(math.isfinite(speed) and speed > 0, f"speed must be above zero m/s, not {speed}")
    used = np.array([name in plant.input_names for name in ACTION_FIELDS])
    most = np.where(used, np.asarray(limits, dtype=float), 0.0)
    radius = trial.radius(speed)
    found = []
    for yaw_rate in (0.0, speed / radius):
        ride = _Ride(controller, plant, speed, yaw_rate, most, trial)
        found.append(_both(ride, trial) if ride.settle() else (0.0, 0.0))
    return Kicks(speed, radius, *found)


def _both(ride: _Ride, trial: Trial) -> tuple[float, float]:
    """Return the largest kicks caught to the left and to the right, deg/s."""
    sizes = np.arange(1, round(trial.most / trial.coarse) + 1) * trial.coarse
    upright = ride.survives(np.concatenate([sizes, -sizes])).reshape(2, -1)
    low = np.array([_first_run(sizes, row) for row in upright])
    between = np.arange(1, math.ceil(trial.coarse / trial.fine)) * trial.fine
    finer = low[:, None] + between
    upright = ride.survives((finer * [[1.0], [-1.0]]).ravel()).reshape(2, -1)
    left, right = (
        min(max(float(start), _first_run(row, good)), trial.most)
        for start, row, good in zip(low, finer, upright, strict=True)
    )
    return left, right


def _first_run(sizes: np.ndarray, caught: np.ndarray) -> float:
    """Return the last of `sizes` before the first that was not caught; 0 if that is the first."""
    missed = np.flatnonzero(~caught)
    last = (missed[0] if missed.size else len(sizes)) - 1
    return float(sizes[last]) if last >= 0 else 0.0


class _Ride:
    """Way of riding from which kicks are tried."""

    def __init__(
        self,
        controller: Controller,
        plant: Plant[Any],
        speed: float,
        yaw_rate: float,
        limits: np.ndarray,
        trial: Trial,
    ) -> None:
        self._controller, self._plant, self._limits, self._trial = controller, plant, limits, trial
        self._yaw_rate = yaw_rate
        zero = np.zeros(1)
        self._state = plant.initial(zero, zero, zero, np.array([speed]))
        self._riding = Riding(controller, 1, plant)
        self._wanted = 0.0

    def _step(self) -> None:
        """Ride one control period."""
        state = self._state
        seen = np.array(
            [
                state.steer_angle,
                state.steer_rate,
                state.lean_angle,
                state.lean_rate,
                state.lean_acceleration,
                wrap_angle(state.heading - self._wanted),
            ]
        ).T
        asked = self._riding.act(seen, state.speed)
        action = np.clip(asked, -self._limits, self._limits)
        self._riding.acted(seen, state.speed, action)
        self._state = self._plant.step(state, *action.T)
        self._wanted += self._yaw_rate * self._plant.time_step

    def _upright(self) -> np.ndarray:
        """Return True (N,) for each bicycle that is still upright."""
        state = self._state
        steered = np.abs(state.steer_angle) > self._trial.steer
        return ~(self._plant.fallen(state, self._trial.lean) | steered)

    def settle(self) -> bool:
        """Ride until the kick is due; False if the bicycle falls before."""
        for _ in range(round(self._trial.before / self._plant.time_step)):
            self._step()
            if not self._upright()[0]:
                return False
        return True

    def survives(self, kicks: np.ndarray) -> np.ndarray:
        """Return whether each of (N,) kicks, deg/s, is caught, bool (N,)."""
        state, riding, wanted = self._state, self._riding, self._wanted
        index = np.zeros(len(kicks), dtype=np.intp)
        self._state = self._plant.pushed(base.take(state, index), np.radians(kicks))
        self._riding = riding.repeated(len(kicks))
        going, caught = np.arange(len(kicks)), np.zeros(len(kicks), dtype=bool)
        for _ in range(round(self._trial.after / self._plant.time_step)):
            self._step()
            upright = self._upright()
            if upright.all():
                continue
            going = going[upright]
            self._state = base.take(self._state, upright)
            self._riding.keep(upright)
            if not len(going):
                break
        caught[going] = True
        self._state, self._riding, self._wanted = state, riding, wanted
        return caught
