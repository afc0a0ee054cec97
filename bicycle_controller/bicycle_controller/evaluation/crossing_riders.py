"""Riders of crossings: along paths, to goals by a policy, straight on by cmd_vel.

Each rides N bicycles along the lines through the origin in directions psi, and passes one other
bicycle each as the controller node's guides do.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from bicycle_common.geometry import heading_error, wrap_angle
from bicycle_controller.control.controller import Controller
from bicycle_controller.control.keep_clear import Mover, keep_clear
from bicycle_controller.control.path import Paths, Place
from bicycle_controller.control.path_follower import PathFollower
from bicycle_controller.control.path_making import path_through
from bicycle_controller.control.riding import Riding
from bicycle_controller.control.swerve import Swerve, pedal_at_most
from bicycle_sim.plants.base import Plant

SLOWEST = 2.0
"""m/s."""
FAR = 150.0
"""m behind the crossing of the goals, which nobody reaches."""


class Rider(Protocol):
    """N bicycles."""

    def act(self, state: Any, other: Mover | None) -> np.ndarray:
        """Return the actions (N, 3); other: as it was seen last, None to ride blindly."""
        ...


class PathRider:
    """Follows the lines as paths."""

    def __init__(
        self, follower: PathFollower, psi: np.ndarray, wanted: np.ndarray, later: bool
    ) -> None:
        """Prepare N rides at wanted speeds (N,) m/s; later: its name comes after the other's."""
        self._follower, self._psi, self._wanted = follower, psi, wanted
        self._later, self._shift = np.full(len(psi), later), np.zeros(len(psi))
        line = path_through([(0.0, 0.0), (0.0, 10.0)], closed=False)
        self._line = Paths([line], np.zeros(len(psi), int))

    def act(self, state: Any, other: Mover | None) -> np.ndarray:
        """Return the actions (N, 3)."""
        psi, speed, zero = self._psi, self._wanted, np.zeros(len(self._psi))
        left = -state.rear_x * np.cos(psi) - state.rear_y * np.sin(psi)
        if other is not None:
            own = Mover(state.rear_x, state.rear_y, psi, state.speed)
            way = keep_clear(own, other, self._later, speed, SLOWEST, left, self._shift)
            speed, self._shift = way.speed, way.shift
        error = np.asarray(wrap_angle(state.heading - psi))
        place = Place(zero + 5.0, left - self._shift, error, zero)
        return self._follower.act(_seen(state, zero), state.speed, place, self._line, speed)


class GoalRider:
    """Rides to far goals by a policy."""

    def __init__(
        self, policy: Controller, plant: Plant[Any], psi: np.ndarray, limits: np.ndarray, name: str
    ) -> None:
        """Prepare N rides with actions within limits (3,) N m, m, N."""
        self._riding, self._limits = Riding(policy, len(psi), plant), limits
        self._goal = -np.sin(psi) * FAR, np.cos(psi) * FAR
        self._swerve = Swerve(name=name)
        self._swerve.pedals = bool(limits[2] > 0.0)

    def act(self, state: Any, other: Mover | None) -> np.ndarray:
        """Return the actions (N, 3)."""
        error = np.asarray(heading_error(state.heading, state.rear_x, state.rear_y, *self._goal))
        most = np.full(len(error), np.inf)
        if other is not None:
            own = Mover(state.rear_x, state.rear_y, state.heading - error, state.speed)
            self._swerve.others = {"other": other}
            most, aside = self._swerve.look(own, SLOWEST)
            error = np.asarray(wrap_angle(error - aside))
        seen = _seen(state, error)
        action = np.array(self._riding.act(seen, state.speed), dtype=float)
        action[:, 2] = pedal_at_most(action[:, 2], state.speed, most)
        action = action.clip(-self._limits, self._limits)
        self._riding.acted(seen, state.speed, action)
        return action


class TwistRider:
    """Rides straight on by cmd_vel."""

    def __init__(self, follower: PathFollower, wanted: np.ndarray, name: str) -> None:
        """Prepare N rides at wanted speeds (N,) m/s."""
        self._follower, self._wanted = follower, wanted
        self._swerve = Swerve(name=name)

    def act(self, state: Any, other: Mover | None) -> np.ndarray:
        """Return the actions (N, 3)."""
        speed, zero = self._wanted, np.zeros(len(self._wanted))
        rate = zero
        if other is not None:
            own = Mover(state.rear_x, state.rear_y, state.heading, state.speed)
            self._swerve.others = {"other": other}
            most, rate = self._swerve.turn(own, zero, SLOWEST, speed)
            speed = np.minimum(most, speed)
        curvature = rate / np.maximum(state.speed, 0.5)
        return self._follower.turn(_seen(state, zero), state.speed, curvature, speed)


def _seen(state: Any, error: np.ndarray) -> np.ndarray:
    """Return the observations (N, 6)."""
    columns = [state.steer_angle, state.steer_rate, state.lean_angle, state.lean_rate]
    return np.column_stack([*columns, state.lean_acceleration, error])
