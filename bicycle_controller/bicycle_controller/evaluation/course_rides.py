"""Ride followers along courses and measure how far from the path they are.

Every error is that of the rear contact's true place, whatever the follower sees.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np

from bicycle_common.geometry import wrap_angle
from bicycle_controller.control.path import Path, Paths, Place
from bicycle_controller.control.speed_profile import speed_profile
from bicycle_sim.plants.base import FALL_ANGLE, Plant, take

SLOWEST = 2.0
"""m/s, the lowest speed of a profile."""
END = 0.3
"""m before the end of a path at which it counts as ridden."""
LOST = 50.0
"""m from its path at which a bicycle counts as lost."""
PATIENCE = 3.0
"""Times the profile's own time after which a ride ends."""


class Follower(Protocol):
    """Controller that rides along paths, such as `PathFollower`."""

    @property
    def policy_id(self) -> str:
        """Id of the follower and its parameters."""
        ...

    def sharpest(self, speed: np.ndarray) -> np.ndarray:
        """Return the largest curvature that can be ridden at speeds, 1/m."""
        ...

    def act(
        self,
        observation: np.ndarray,
        speed: np.ndarray,
        place: Place,
        paths: Paths,
        wanted_speed: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return (N, 3) actions; see `PathFollower.act`."""
        ...


@dataclass(frozen=True)
class Start:
    """Starts of rides; every field is (N,)."""

    left: np.ndarray
    """m to the left of the path's start."""
    turned: np.ndarray
    """rad to the left of its direction."""

    @classmethod
    def on_path(cls, count: int) -> Start:
        """Return starts on the path and along it."""
        return cls(np.zeros(count), np.zeros(count))


@dataclass(frozen=True)
class CourseRides:
    """Results of N rides; every field is (N,), the traces are lists of N arrays."""

    finished: np.ndarray
    """bool: True if the end of the last lap was reached."""
    fallen: np.ndarray
    """bool."""
    time: np.ndarray
    """s ridden."""
    distance: np.ndarray
    """m ridden."""
    rms: np.ndarray
    """Root of the mean squared cross-track error, m."""
    largest: np.ndarray
    """Largest cross-track error, m."""
    end_error: np.ndarray
    """Cross-track error at the end, m, positive to the left."""
    torque: np.ndarray
    """Root of the mean squared torque, N m."""
    peak_lean: np.ndarray
    """Largest lean, rad."""
    speed: np.ndarray
    """Mean speed, m/s."""


@dataclass
class Trace:
    """Record of one ride at each step; arrays of (steps,)."""

    x: np.ndarray
    y: np.ndarray
    cross_track: np.ndarray
    along: np.ndarray
    speed: np.ndarray
    torque: np.ndarray
    lean: np.ndarray


def ride_courses(
    follower: Follower,
    plant: Plant[Any],
    paths: Sequence[Path],
    speeds: Sequence[float],
    laps: Sequence[int] | None = None,
    start: Start | None = None,
    limits: tuple[float, float] = (2.0, 100.0),
    speed_limits: tuple[float, float] | None = (1.0, 8.0),
    sense: Callable[[Any, np.ndarray], tuple[np.ndarray, ...]] | None = None,
    traced: int = 0,
) -> tuple[CourseRides, list[Trace]]:
    """Ride one bicycle along each path.

    Args:
        follower: chooses the actions.
        plant: the bicycles.
        paths: one for each of N bicycles.
        speeds: m/s, wanted where no turn limits it.
        laps: of each closed path; one by default.
        start: on the path by default.
        limits: N m and N, largest |T| and |F|.
        speed_limits: m/s, bounds of the plant's speed, or None.
        sense: returns x, y and heading (N,) as the follower sees them, of the state and the rows
            of the bicycles; the truth by default.
        traced: number of rides whose traces are kept, the first ones.

    Returns:
        The results, and the traces.
    """
    ride = _Rides(follower, plant, paths, speeds, laps, start, limits, speed_limits, traced)
    while ride.count:
        ride.step(sense)
    return CourseRides(**ride.results), ride.traces()


class _Rides:
    """Rides in progress and the results of all."""

    def __init__(
        self,
        follower: Follower,
        plant: Plant[Any],
        paths: Sequence[Path],
        speeds: Sequence[float],
        laps: Sequence[int] | None,
        start: Start | None,
        limits: tuple[float, float],
        speed_limits: tuple[float, float] | None,
        traced: int,
    ) -> None:
        n = len(paths)
        self.follower, self.plant = follower, plant
        self.limits, self.speed_limits = limits, speed_limits
        self.paths = Paths(paths)
        profiles = [
            speed_profile(path, wanted, follower.sharpest, min(SLOWEST, wanted))
            for path, wanted in zip(paths, speeds, strict=True)
        ]
        self.profile = np.concatenate(profiles)
        start = start or Start.on_path(n)
        zero = np.zeros(n)
        x, y = self.paths.point(zero)
        psi = np.array([path.heading[0] for path in paths])
        x, y = x - start.left * np.cos(psi), y - start.left * np.sin(psi)
        first = np.array([profile[0] for profile in profiles])
        heading = np.asarray(wrap_angle(psi + start.turned))
        self.state = plant.initial(x, y, heading, first)
        self.along = self.truth = self.paths.join(x, y, heading)
        rounds = np.ones(n) if laps is None else np.asarray(laps, dtype=float)
        rounds = np.where(self.paths.closed, rounds, 1.0)
        # A loop ends where it was joined, an open path at its own end.
        self.ends = rounds * self.paths.length + np.where(self.paths.closed, self.along, -END)
        both = zip(paths, profiles, strict=True)
        needed = np.array([float((path.spacing / profile).sum()) for path, profile in both])
        self.most = np.ceil((PATIENCE * rounds * needed + 20.0) / plant.time_step)
        self.index = np.arange(n)
        self.steps = 0
        self.sums = {
            name: np.zeros(n) for name in ("square", "torque", "largest", "lean", "distance")
        }
        self.results = {item.name: np.zeros(n) for item in fields(CourseRides)}
        for name in ("finished", "fallen"):
            self.results[name] = np.zeros(n, dtype=bool)
        self.traced: list[list[tuple[float, ...]]] = [[] for _ in range(min(traced, n))]

    @property
    def count(self) -> int:
        """Number of bicycles that still ride."""
        return len(self.index)

    def step(self, sense: Callable[[Any, np.ndarray], tuple[np.ndarray, ...]] | None) -> None:
        """Ride one period."""
        s, paths = self.state, self.paths
        x, y, heading = s.rear_x, s.rear_y, s.heading
        if sense is not None:
            x, y, heading = sense(s, self.index)
        place = paths.locate(self.along, x, y, heading)
        self.along = place.along
        seen = np.column_stack(
            [s.steer_angle, s.steer_rate, s.lean_angle, s.lean_rate, s.lean_acceleration, 0.0 * x]
        )
        # The pedal takes a moment to change the speed, so it looks half a second ahead.
        wanted = paths.values(self.profile, place.along + 0.5 * s.speed)
        action = self.follower.act(seen, s.speed, place, paths, wanted)
        torque = np.clip(action[:, 0], -self.limits[0], self.limits[0])
        pedal = np.clip(action[:, 2], -self.limits[1], self.limits[1])
        self.state = self.plant.step(s, torque, action[:, 1], pedal, self.speed_limits)
        self.steps += 1
        self._measure(s, torque)

    def _measure(self, before: Any, torque: np.ndarray) -> None:
        s, sums = self.state, self.sums
        true = self.paths.locate(self.truth, s.rear_x, s.rear_y, s.heading)
        self.truth = true.along
        error = np.abs(true.cross_track)
        sums["square"] += error * error
        sums["torque"] += torque * torque
        sums["largest"] = np.maximum(sums["largest"], error)
        sums["lean"] = np.maximum(sums["lean"], np.abs(s.lean_angle))
        sums["distance"] += np.hypot(s.rear_x - before.rear_x, s.rear_y - before.rear_y)
        rows = (s.rear_x, s.rear_y, true.cross_track, true.along, s.speed, torque, s.lean_angle)
        for row, number in enumerate(self.index):
            if number >= len(self.traced):
                break
            self.traced[number].append(tuple(float(values[row]) for values in rows))
        fallen = self.plant.fallen(s, FALL_ANGLE)
        finished = ~fallen & (true.along >= self.ends)
        ended = fallen | finished | (self.steps >= self.most) | (error > LOST)
        if ended.any():
            self._store(ended, finished, fallen, true.cross_track)

    def _store(
        self, ended: np.ndarray, finished: np.ndarray, fallen: np.ndarray, error: np.ndarray
    ) -> None:
        """Store the results of the rides that end, and go on with the others."""
        to, sums, time = self.index[ended], self.sums, self.steps * self.plant.time_step
        values = {
            "finished": finished,
            "fallen": fallen,
            "time": np.full(self.count, time),
            "distance": sums["distance"],
            "rms": np.sqrt(sums["square"] / self.steps),
            "largest": sums["largest"],
            "end_error": error,
            "torque": np.sqrt(sums["torque"] / self.steps),
            "peak_lean": sums["lean"],
            "speed": sums["distance"] / time,
        }
        for name, value in values.items():
            self.results[name][to] = value[ended]
        on = ~ended
        self.state, self.plant = take(self.state, on), self.plant.take(on)
        self.paths = self.paths.keep(on)
        for name in ("along", "truth", "ends", "most", "index"):
            setattr(self, name, getattr(self, name)[on])
        self.sums = {name: value[on] for name, value in sums.items()}

    def traces(self) -> list[Trace]:
        """Return the traces that were kept."""
        return [Trace(*np.array(rows).T) for rows in self.traced]
