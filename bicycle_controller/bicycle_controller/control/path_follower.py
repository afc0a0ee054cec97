"""Follows paths: LQR with preview of the curvature on cross-track and heading error.

Near the path it is the linear optimum of `follow_gains`. Far from it, the wanted turn is limited
to what the bicycle can ride, and the path is approached at a limited angle, so that it is joined
from anywhere. The pedal holds the wanted speed, see `speed_profile`.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict
from typing import Any

import numpy as np

from bicycle_common.geometry import wrap_angle
from bicycle_controller.control.follow_gains import SPEEDS, FollowConfig, design
from bicycle_controller.control.guide import PlannedTurns
from bicycle_controller.control.path import Paths, Place
from bicycle_sim.plants.base import Plant

RIDDEN_TORQUE = 0.6
"""Share of the largest torque that may hold a turn: the rest balances."""
PLANNED_LEAN, PLANNED_STEER, PLANNED_TORQUE = 0.7, 0.7, 0.6
"""Shares of the largest lean, steering and torque that a path may ask for: the rest corrects."""


ALONG = 0.5
"""rad of heading error up to which the path's curvature counts; at twice as much not."""
STANLEY_GAIN = 0.4
"""1/s, of the cross-track error; 2.5 in the car."""
STANLEY_SHARE = 0.3
"""Steering per error; 1 in the car."""


class PathFollower:
    """The classical follower; it holds no state between calls."""

    room = math.inf
    """Times the limit of extrapolated lean that it is trusted with: it balances by a feedback law
    that catches the kicks that the fallback catches, so that a hand-over would save nothing."""

    def __init__(self, plant: Plant[Any], config: FollowConfig | None = None) -> None:
        """Compute the gains for every speed of SPEEDS."""
        self.plant, self.config = plant, config or FollowConfig()
        found = [design(self.config, plant, float(speed)) for speed in SPEEDS]
        self._feedback = np.array([gains.feedback for gains in found])
        self._preview = np.array([gains.preview for gains in found])
        self._steer = np.array([gains.steer for gains in found])
        self._hold = np.array([gains.hold for gains in found])
        self._turn = np.array([gains.turn for gains in found])
        self._lean_law = plant.steady_lean_law(self.config.steer_limit)
        small = np.full(len(SPEEDS), 0.01)
        self._tilt = self._lean_law(small, SPEEDS) / small
        whole, planned = (1.0, 1.0, RIDDEN_TORQUE), (PLANNED_LEAN, PLANNED_STEER, PLANNED_TORQUE)
        self._tight = np.array([self._rideable(row, whole) for row in range(len(SPEEDS))])
        self._sharpest = np.array([self._rideable(row, planned) for row in range(len(SPEEDS))])
        self._ahead = np.arange(self._preview.shape[1] + 1) * plant.time_step

    @property
    def policy_id(self) -> str:
        """`follow-` and a digest of tuning and plant."""
        text = json.dumps([asdict(self.config), json.loads(self.plant.to_json())])
        return "follow-" + hashlib.sha256(text.encode()).hexdigest()[:8]

    def sharpest(self, speed: np.ndarray) -> np.ndarray:
        """Return the largest curvature that a path may have at speeds, 1/m.

        Lean, steering and the torque that holds the turn limit it.
        """
        return np.interp(speed, SPEEDS, self._sharpest)

    def turns(self, speed: float, right: float, left: float) -> PlannedTurns:
        """Return the steady turns between two curvatures, as far as they can be ridden.

        Args:
            speed: m/s.
            right: 1/m, zero or less.
            left: 1/m, zero or more.
        """
        there = np.array([speed])
        row = self._row(there)
        tight = self._tight[row]
        steer = np.arctan(tight * self._steer[row])
        return PlannedTurns(
            lean=self._lean_law(steer, there),
            steer=steer,
            torque=self._hold[row] * tight,
            right=np.maximum(right / tight, -1.0),
            left=np.minimum(left / tight, 1.0),
            room=self.room,
        )

    def act(
        self,
        observation: np.ndarray,
        speed: np.ndarray,
        place: Place,
        paths: Paths,
        wanted_speed: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the action of each bicycle.

        Args:
            observation: (N, 6), see `OBSERVATION_FIELDS`; its heading error is not used.
            speed: (N,) m/s.
            place: of the N bicycles on their paths.
            paths: the paths.
            wanted_speed: (N,) m/s to hold with the pedal; None leaves the pedal alone.

        Returns:
            (N, 3): N m of torque, m of displacement (zero), N of pedal force.
        """
        row = self._row(speed)
        near = np.clip(2.0 - np.abs(place.cross_track) / self.config.near, 0.0, 1.0)
        # A bicycle across the path, or against it, does not meet the path's next turns.
        near = near * np.clip(2.0 - np.abs(place.heading_error) / ALONG, 0.0, 1.0)
        planned = self._planned(row, speed, place, paths) * near
        # A place beside a turn is on a circle of another radius.
        there = place.curvature / np.maximum(0.3, 1.0 - place.curvature * place.cross_track)
        turn = self._wanted(row, speed, place, there * near)
        return self.turn(observation, speed, turn, wanted_speed, planned)

    def turn(
        self,
        observation: np.ndarray,
        speed: np.ndarray,
        curvature: np.ndarray,
        wanted_speed: np.ndarray | None = None,
        planned: np.ndarray | float = 0.0,
    ) -> np.ndarray:
        """Return the action that leads into a turn, limited to what can be ridden.

        Args:
            observation: (N, 6), see `OBSERVATION_FIELDS`; its heading error is not used.
            speed: (N,) m/s.
            curvature: (N,) 1/m wanted, positive to the left.
            wanted_speed: (N,) m/s to hold with the pedal; None leaves the pedal alone.
            planned: (N,) N m of torque for the turns to come.

        Returns:
            (N, 3), see `act`.
        """
        config, row = self.config, self._row(speed)
        gain, tight = self._feedback[row], self._tight[row]
        steer, steer_rate, lean, lean_rate = observation.T[:4]
        turn = np.clip(curvature, -tight, tight)
        wanted_steer = np.arctan(turn * self._steer[row])
        wanted_lean = self._lean_law(wanted_steer, speed)
        lead = config.lean_lead * config.torque_limit / np.abs(gain[:, 0])
        ahead = np.clip(wanted_lean - lean, -lead, lead)
        # A turn too far ahead would saturate the torque, so a wider one is ridden first.
        wanted_steer = wanted_steer - (wanted_lean - lean - ahead) / self._tilt[row]
        turn = np.tan(np.clip(wanted_steer, -1.2, 1.2)) / self._steer[row]
        torque = self._hold[row] * turn + planned
        torque = torque + gain[:, 0] * ahead - gain[:, 1] * lean_rate
        torque = torque - gain[:, 2] * (steer - wanted_steer) - gain[:, 3] * steer_rate
        action = np.zeros((len(speed), 3))
        action[:, 0] = np.clip(torque, -config.torque_limit, config.torque_limit)
        if wanted_speed is not None:
            pedal = config.speed_gain * (wanted_speed - speed)
            action[:, 2] = np.clip(pedal, -config.pedal_limit, config.pedal_limit)
        return action

    def _row(self, speed: np.ndarray) -> np.ndarray:
        """Return the nearest of SPEEDS, (N,)."""
        row = np.rint((speed - SPEEDS[0]) / (SPEEDS[1] - SPEEDS[0]))
        return np.asarray(np.clip(np.nan_to_num(row), 0, len(SPEEDS) - 1).astype(np.intp))

    def _wanted(
        self, row: np.ndarray, speed: np.ndarray, place: Place, there: np.ndarray
    ) -> np.ndarray:
        """Return the curvature wanted now, (N,) 1/m; `there` is the path's beside the bicycle."""
        gain, most = self._feedback[row], self.config.approach
        toward = most * np.tanh(gain[:, 5] / gain[:, 4] * place.cross_track / most)
        error = np.asarray(wrap_angle(place.heading_error + toward))
        return self._turn[row] * error / self._steer[row] + there

    def _planned(
        self, row: np.ndarray, speed: np.ndarray, place: Place, paths: Paths
    ) -> np.ndarray:
        """Return the torque for the changes of curvature to come, (N,) N m."""
        coming = place.along[:, None] + np.maximum(speed, 0.1)[:, None] * self._ahead
        curvature = paths.curvature(coming)
        tight = self._tight[row][:, None]
        curvature = np.clip(curvature, -tight, tight)
        change = curvature[:, :-1] - curvature[:, 1:]
        return -np.asarray((self._preview[row] * change).sum(axis=1))

    def _rideable(self, row: int, shares: tuple[float, float, float]) -> float:
        """Return the largest curvature at one of SPEEDS, 1/m, for shares of the limits."""
        config, speed = self.config, float(SPEEDS[row])
        lean_limit, steer_limit = shares[0] * config.lean_limit, shares[1] * config.steer_limit
        steer = np.linspace(0.0, steer_limit, 601)
        lean = np.abs(self._lean_law(steer, np.full_like(steer, speed)))
        steep = float(np.interp(lean_limit, np.maximum.accumulate(lean), steer))
        by_torque = shares[2] * config.torque_limit / max(abs(self._hold[row]), 1e-6)
        return min(math.tan(steep) / abs(self._steer[row]), float(by_torque))


class StanleyFollower(PathFollower):
    """The baseline: the steering law of the car Stanley, with the same balance and no preview.

    The heading error and the arctangent of the cross-track error over the speed are the steering,
    of which a bicycle, which must lean first, can follow only a share; the path's curvature is
    added. Source: G. M. Hoffmann et al., American Control Conference 2007, eq. 5.
    """

    @property
    def policy_id(self) -> str:
        """`stanley-` and the digest of tuning and plant."""
        return super().policy_id.replace("follow-", "stanley-")

    def _wanted(
        self, row: np.ndarray, speed: np.ndarray, place: Place, there: np.ndarray
    ) -> np.ndarray:
        toward = np.arctan(STANLEY_GAIN * place.cross_track / np.maximum(speed, 0.5))
        error = np.asarray(wrap_angle(place.heading_error + toward))
        steer = np.clip(STANLEY_SHARE * -error, -1.0, 1.0)
        return np.tan(steer) / self._steer[row] + there

    def _planned(
        self, row: np.ndarray, speed: np.ndarray, place: Place, paths: Paths
    ) -> np.ndarray:
        return np.zeros(len(speed))
