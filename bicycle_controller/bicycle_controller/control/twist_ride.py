"""A guide by `cmd_vel`: a speed and a yaw rate become a turn that the bicycle can ride."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from bicycle_common.observation import observation
from bicycle_common.types import BicycleState
from bicycle_common.validation import require
from bicycle_controller.control.guide import ANY_TURN, PathEnd, PlannedTurns
from bicycle_controller.control.keep_clear import Mover
from bicycle_controller.control.path_follower import PathFollower
from bicycle_controller.control.swerve import Swerve

SETTLING = 3.0
"""s for which a bicycle may still be in the turn that it rode before."""


@dataclass(frozen=True)
class TwistLimits:
    """Bounds of what `cmd_vel` may ask for.

    Raises:
        ValueError: on a number that makes no sense.
    """

    slowest: float = 2.0
    """m/s; a lower speed, zero too, is ridden as this one: a bicycle that stands falls."""
    fastest: float = 5.0
    """m/s."""
    yaw_rate: float = 1.0
    """rad/s, largest size."""
    timeout: float = 0.5
    """s without a new one after which the bicycle rides straight on."""

    def __post_init__(self) -> None:
        good = all(math.isfinite(value) and value > 0 for value in vars(self).values())
        require(good, "the limits of cmd_vel must be above zero")
        require(self.slowest <= self.fastest, "the lowest speed of cmd_vel is above its highest")


class TwistRide:
    """A guide that holds the last commanded speed and yaw rate."""

    def __init__(self, follower: PathFollower, limits: TwistLimits) -> None:
        self._follower, self.limits = follower, limits
        self._speed, self._yaw_rate = limits.slowest, 0.0
        self._heard: float | None = None
        self._fresh = False
        self._ridden: deque[tuple[float, float]] = deque()
        self.over = False
        self.silent = False
        """True if no command has come for too long."""
        self.swerve = Swerve()
        """Memory of how it passes other bicycles."""

    @property
    def policy_id(self) -> str:
        """`cmd_vel-` and the follower's digest."""
        return "cmd_vel-" + self._follower.policy_id.rpartition("-")[2]

    def command(self, speed: float, yaw_rate: float) -> None:
        """Take a new command, m/s and rad/s, positive to the left.

        Raises:
            ValueError: if it is not finite.
        """
        require(math.isfinite(speed) and math.isfinite(yaw_rate), "a twist must be finite")
        limits = self.limits
        self._speed = min(max(speed, limits.slowest), limits.fastest)
        self._yaw_rate = min(max(yaw_rate, -limits.yaw_rate), limits.yaw_rate)
        self._fresh = True

    def end(self, status: PathEnd, why: str) -> None:
        """Stop steering."""
        self.over = True

    def act(self, snapshot: BicycleState, time: float) -> np.ndarray:
        """Return the action (3,) for a state; see `Guide.act`."""
        if self._fresh or self._heard is None or time < self._heard:
            self._heard, self._fresh = time, False
        self.silent = time - self._heard > self.limits.timeout
        yaw_rate = 0.0 if self.silent else self._yaw_rate
        speed = np.array([snapshot.speed])
        wanted = np.array([self._speed])
        if self.swerve.others:
            yaw_rate, wanted = self._past_others(snapshot, time, yaw_rate)
        curvature = yaw_rate / np.maximum(speed, 0.5)
        if self._ridden and time < self._ridden[-1][0]:
            self._ridden.clear()
        self._ridden.append((time, float(curvature[0])))
        while time - self._ridden[0][0] > SETTLING:
            self._ridden.popleft()
        seen = observation(snapshot, 0.0)[None]
        return np.asarray(self._follower.turn(seen, speed, curvature, wanted)[0])

    def _past_others(
        self, snapshot: BicycleState, time: float, yaw_rate: float
    ) -> tuple[float, np.ndarray]:
        """Return the yaw rate, rad/s, and the speed, (1,) m/s, that keep clear of others."""
        numbers = snapshot.rear_x, snapshot.rear_y, snapshot.heading, snapshot.speed
        since = time - self._ridden[-1][0] if self._ridden else 0.0
        most, more = self.swerve.turn(
            Mover(*(np.array([value]) for value in numbers)),
            np.array([yaw_rate * max(0.0, since)]),
            self.limits.slowest,
            np.array([self._speed]),
        )
        return yaw_rate + float(more[0]), np.minimum(most, self._speed)

    def turns(self, speed: float) -> PlannedTurns | None:
        """Return the turns that were commanded within the last seconds."""
        if math.isinf(self._follower.room):
            return ANY_TURN
        curvatures = [0.0, *(curvature for _, curvature in self._ridden)]
        return self._follower.turns(speed, min(curvatures), max(curvatures))

    def heading_error(self, snapshot: BicycleState) -> float:
        """Return psi_g that makes the fallback turn the same way, rad."""
        return (
            0.0 if self.silent else -math.copysign(min(abs(self._yaw_rate), 0.5), self._yaw_rate)
        )
