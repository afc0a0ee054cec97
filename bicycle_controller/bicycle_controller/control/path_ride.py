"""A ride along a path: place, errors and end."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from bicycle_common.geometry import heading_error
from bicycle_common.observation import observation
from bicycle_common.types import BicycleState
from bicycle_controller.control.courses import Course
from bicycle_controller.control.guide import ANY_TURN, PathEnd, PathReport, PlannedTurns
from bicycle_controller.control.keep_clear import Mover, keep_clear
from bicycle_controller.control.path import Paths, Place
from bicycle_controller.control.path_follower import ALONG, PathFollower
from bicycle_controller.control.speed_profile import speed_profile

END = 0.3
"""m before the end of an open path at which it counts as ridden."""
NEAR = 1.0
"""m from the end of an open path within which a bicycle that joins it there has ridden it."""
LOST = 100.0
"""m from its path, beyond its distance at the start, at which a bicycle counts as lost."""
PATIENCE = 3.0
"""Times the profile's own time after which a path is given up, and 60 s more."""
SIGHT = 8.0
"""m ahead on the path that the fallback steers to."""
TURNING = np.linspace(-1.0, 2.0, 31)
"""s of riding: a bicycle leans before a turn of its path, and rises after it."""


class PathRide:
    """A guide along a path; it joins it from wherever the bicycle is."""

    def __init__(
        self,
        follower: PathFollower,
        course: Course,
        path_id: int,
        slowest: float = 2.0,
        from_start: bool = False,
    ) -> None:
        """Prepare the ride; it begins with the first state.

        Args:
            follower: of the ridden bicycle.
            course: what is ridden.
            path_id: number of the path.
            slowest: m/s, lowest speed in turns.
            from_start: True to begin at the path's start, however near another place is.
        """
        self.course, self.path_id = course, path_id
        self._follower = follower
        self._paths = Paths([course.path])
        self.laps = course.laps if course.path.closed else 1
        self._profile = speed_profile(
            course.path, course.speed, follower.sharpest, min(slowest, course.speed)
        )
        lap = course.path.length
        times = self.laps * float((course.path.spacing / self._profile).sum())
        self._patience = PATIENCE * times + 60.0
        self.length = lap * self.laps
        self._from_start = from_start
        self._along: np.ndarray | None = None
        self._entered = self._from = self._begun = self._now = 0.0
        self._cross = self._error = self._square = self._largest = 0.0
        self._steps = 0
        self._farthest = 0.0
        self._wanted = float(self._profile[0])
        self.status, self._why = PathEnd.ACTIVE, ""
        self.others: dict[str, Mover] = {}
        """Other bicycles to keep clear of, by name."""
        self.name = ""
        """Own name among them."""
        self.pedals = True
        """False if the speed cannot be changed, so that it only swerves past others."""
        self.yielding = False
        self._shift, self._slowest = 0.0, slowest
        self._shifts: dict[str, float] = {}

    @property
    def policy_id(self) -> str:
        """Id of the follower."""
        return self._follower.policy_id

    @property
    def over(self) -> bool:
        """True if the path has been ridden, or was given up."""
        return self.status is not PathEnd.ACTIVE

    @property
    def along(self) -> float:
        """Distance along the path, m; along a loop, from where it was joined."""
        if self._along is None:
            return 0.0
        # A loop has no end of its own: its laps count from the place where it was joined.
        first = self._from if self.course.path.closed else 0.0
        return float(self._along[0]) - first

    def end(self, status: PathEnd, why: str) -> None:
        """Stop following, unless it is over already."""
        if not self.over:
            self.status, self._why = status, why

    def act(self, snapshot: BicycleState, time: float) -> np.ndarray:
        """Return the action (3,) for a state; see `Guide.act`."""
        x, y = np.array([snapshot.rear_x]), np.array([snapshot.rear_y])
        heading, speed = np.array([snapshot.heading]), np.array([snapshot.speed])
        if self._along is None:
            start = np.zeros(1) if self._from_start else self._paths.join(x, y, heading)
            self._along = start
            self._from, self._begun = float(start[0]), time
            self._entered = math.inf
            self._refuse_if_past(snapshot)
        place = self._paths.locate(self._along, x, y, heading)
        self._along = place.along
        self._now = time
        if not self.over:
            self._measure(float(place.cross_track[0]), float(place.heading_error[0]))
        wanted = self._paths.values(self._profile, place.along + 0.5 * speed)
        if self.others:
            wanted = self._past_others(snapshot, wanted, place)
            beside = place.cross_track - self._shift
            place = replace(place, cross_track=beside)
        self._wanted = float(wanted[0])
        seen = observation(snapshot, 0.0)[None]
        return np.asarray(self._follower.act(seen, speed, place, self._paths, wanted)[0])

    def _refuse_if_past(self, snapshot: BicycleState) -> None:
        """End a ride that joins an open path at its end, from farther than `NEAR`."""
        if self.course.path.closed or self._from < self.length - END:
            return
        x, y = self._paths.point(np.array([self.length]))
        away = math.hypot(float(x[0]) - snapshot.rear_x, float(y[0]) - snapshot.rear_y)
        if away > NEAR:
            self.end(
                PathEnd.LOST,
                f"its end is the nearest place, {away:.1f} m away, so nothing is left to ride: "
                "give a path that goes on beyond the bicycle",
            )

    def _past_others(self, snapshot: BicycleState, wanted: np.ndarray, place: Place) -> np.ndarray:
        """Return the speed at which the bicycle keeps clear of all others, (1,) m/s."""
        names, count = list(self.others), len(self.others)
        along = snapshot.heading - float(place.heading_error[0])
        numbers = snapshot.rear_x, snapshot.rear_y, along, snapshot.speed
        own = Mover(*(np.full(count, value) for value in numbers))
        other = Mover(*map(np.concatenate, zip(*self.others.values(), strict=True)))
        later = np.array([self.name > name for name in names])
        last = np.array([self._shifts.get(name, 0.0) for name in names])
        slowest = min(self._slowest, float(wanted[0])) if self.pedals else float(wanted[0])
        way = keep_clear(
            own, other, later, np.repeat(wanted, count), slowest, place.cross_track, last
        )
        self._shifts.update(zip(names, way.shift.tolist(), strict=True))
        self._shift = float(way.shift[np.argmax(np.abs(way.shift))])
        self.yielding = bool(way.yields.any())
        return np.minimum(wanted, way.speed.min())

    def _measure(self, cross: float, error: float) -> None:
        assert self._along is not None
        self._cross, self._error = cross, error
        along = float(self._along[0])
        # A bicycle that begins far from the path joins it first, which is not an error.
        on_path = abs(cross) < 0.5 and abs(error) < 0.2
        if math.isinf(self._entered) and (on_path or along - self._from > 30.0):
            self._entered = abs(cross)
        if math.isinf(self._entered):
            self._farthest = max(self._farthest, abs(cross))
        else:
            self._steps += 1
            self._square += cross * cross
            self._largest = max(self._largest, abs(cross))
        if self.along >= self.length - (0.0 if self.course.path.closed else END):
            self.end(PathEnd.FINISHED, "ridden to its end")
        elif abs(cross) > LOST + self._farthest:
            self.end(PathEnd.LOST, f"{abs(cross):.0f} m off the path")
        elif self._now - self._begun > self._patience:
            self.end(PathEnd.LOST, f"not ridden within {self._patience:.0f} s")

    def turns(self, speed: float) -> PlannedTurns | None:
        """Return the path's turns about here; away from the path any that it could ask for."""
        if math.isinf(self._follower.room):
            return ANY_TURN
        if self._along is None:
            return None
        off = max(abs(self._cross) / self._follower.config.near, abs(self._error) / ALONG)
        if off > 1.0:
            sharp = float(self._follower.sharpest(np.array([speed]))[0])
            return self._follower.turns(speed, -sharp, sharp)
        near = self._paths.curvature(self._along[:, None] + speed * TURNING)
        return self._follower.turns(speed, min(0.0, near.min()), max(0.0, near.max()))

    def heading_error(self, snapshot: BicycleState) -> float:
        """Return psi_g to a point ahead on the path, rad."""
        along = np.zeros(1) if self._along is None else self._along
        x, y = self._paths.point(along + SIGHT)
        return float(
            heading_error(
                snapshot.heading, snapshot.rear_x, snapshot.rear_y, float(x[0]), float(y[0])
            )
        )

    def report(self) -> PathReport:
        """Return the ride's progress."""
        along = max(0.0, self.along)
        lap = self.length / self.laps
        rms = math.sqrt(self._square / self._steps) if self._steps else math.nan
        largest = self._largest if self._steps else math.nan
        number = min(self.laps, 1 + int(along / lap))
        text = self._why
        if self.status is PathEnd.ACTIVE:
            text = f"lap {number} of {self.laps}: {along:.1f} of {self.length:.1f} m"
        elif self._steps:
            text += f"; {rms:.2f} m rms, {largest:.2f} m at most off the path"
        return PathReport(
            self.path_id,
            self.course.name,
            self.status,
            number,
            self.laps,
            along,
            self.length,
            self._cross,
            self._error,
            self._wanted,
            rms,
            largest,
            self._now - self._begun,
            text,
        )
