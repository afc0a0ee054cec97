"""Ride a course by what sensors say: the follower sees estimates, errors are those of the truth.

Each ride begins at rest at the path's start, held upright, where the estimator calibrates; then it
rolls at the path's speed, and all errors count.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from bicycle_controller.control.courses import Course
from bicycle_controller.control.path import Paths
from bicycle_controller.control.speed_profile import speed_profile
from bicycle_controller.estimation.kalman import Filter
from bicycle_controller.estimation.queue import Arrivals
from bicycle_controller.evaluation.course_rides import (
    END,
    LOST,
    PATIENCE,
    SLOWEST,
    CourseRides,
    Follower,
    Trace,
)
from bicycle_sim.plants.base import FALL_ANGLE, Plant
from bicycle_sim.sensors.settings import SensorSettings
from bicycle_sim.sensors.suite import SensorSuite


def ride_sensed(
    follower: Follower,
    plant: Plant[Any],
    course: Course,
    sensors: SensorSettings,
    count: int,
    seed: int,
    speed: float | None = None,
    limits: tuple[float, float] = (2.0, 100.0),
    speed_limits: tuple[float, float] | None = (1.0, 8.0),
) -> tuple[CourseRides, Trace]:
    """Ride `count` bicycles along one course.

    Args:
        follower: chooses the actions.
        plant: the bicycles; the estimator has their parameters.
        course: what is ridden.
        sensors: on each of them.
        count: N.
        seed: of the sensors' errors; not negative.
        speed: m/s instead of the course's.
        limits: N m and N, largest |T| and |F|.
        speed_limits: m/s, bounds of the plant's speed, or None.

    Returns:
        The results, and the trace of the first ride.
    """
    rides = _Rides(follower, plant, course, sensors, count, seed, speed or course.speed)
    while rides.going.any():
        rides.step(limits, speed_limits)
    return rides.results(), Trace(*np.array(rides.traced).T)


class _Rides:
    """N rides in progress; those that have ended are simulated on, but not counted."""

    def __init__(
        self,
        follower: Follower,
        plant: Plant[Any],
        course: Course,
        sensors: SensorSettings,
        count: int,
        seed: int,
        speed: float,
    ) -> None:
        self.follower, self.plant = follower, plant
        self.paths = Paths([course.path], np.zeros(count, dtype=np.intp))
        self.profile = speed_profile(course.path, speed, follower.sharpest, min(SLOWEST, speed))
        zero = np.zeros(count)
        x, y = self.paths.point(zero)
        heading = np.full(count, course.path.heading[0])
        heading = np.arctan2(np.sin(heading), np.cos(heading))
        self.state = plant.initial(x, y, heading, np.full(count, self.profile[0]))
        self.suite = SensorSuite(sensors, plant, count, seed)
        self.filter = Filter(plant, sensors, count)
        self.arrivals = Arrivals()
        self.arrivals.add(self.suite.rest(self.state))
        self._take()
        self.filter.place(x, y, heading)
        self.suite.begin(self.state)
        self.along, self.truth = zero, zero
        laps = course.laps if course.path.closed else 1
        self.end = laps * course.path.length - (0.0 if course.path.closed else END)
        needed = laps * float((course.path.spacing / self.profile).sum())
        self.most = int(np.ceil((PATIENCE * needed + 20.0) / plant.time_step))
        self.going = np.ones(count, dtype=bool)
        self.finished, self.fallen = ~self.going, ~self.going
        self.steps = np.zeros(count)
        self.square, self.largest, self.last = zero, zero, zero
        self.torque, self.lean, self.distance = zero, zero, zero
        self.traced: list[tuple[float, ...]] = []

    def _take(self) -> None:
        for reading, mask in self.arrivals.due(self.suite.time):
            self.filter.take(reading, mask)

    def step(self, limits: tuple[float, float], speed_limits: tuple[float, float] | None) -> None:
        """Ride one period."""
        e = self.filter.estimate(self.suite.time)
        place = self.paths.locate(self.along, e.x, e.y, e.heading)
        self.along = place.along
        columns = [e.steer_angle, e.steer_rate, e.lean_angle, e.lean_rate, e.lean_acceleration]
        seen = np.column_stack([*columns, 0.0 * e.x])
        wanted = self.paths.values(self.profile, place.along + 0.5 * e.speed)
        action = self.follower.act(seen, e.speed, place, self.paths, wanted)
        torque = np.where(self.going, np.clip(action[:, 0], -limits[0], limits[0]), 0.0)
        pedal = np.where(self.going, np.clip(action[:, 2], -limits[1], limits[1]), 0.0)
        trace = self.plant.trace(self.state, torque, action[:, 1], pedal, speed_limits, None)
        self.arrivals.add(self.suite.advance(trace, self.plant.time_step))
        before, self.state = self.state, trace[-1]
        self._measure(before, torque)
        self._take()

    def _measure(self, before: Any, torque: np.ndarray) -> None:
        s, on = self.state, self.going
        true = self.paths.locate(self.truth, s.rear_x, s.rear_y, s.heading)
        self.truth = true.along
        error = np.abs(true.cross_track)
        moved = np.hypot(s.rear_x - before.rear_x, s.rear_y - before.rear_y)
        self.steps = self.steps + on
        self.square = self.square + on * error * error
        self.torque = self.torque + on * torque * torque
        self.distance = self.distance + on * moved
        self.largest = np.where(on, np.maximum(self.largest, error), self.largest)
        self.lean = np.where(on, np.maximum(self.lean, np.abs(s.lean_angle)), self.lean)
        self.last = np.where(on, true.cross_track, self.last)
        if on[0]:
            row = (s.rear_x, s.rear_y, true.cross_track, true.along, s.speed, torque, s.lean_angle)
            self.traced.append(tuple(float(values[0]) for values in row))
        fell = on & self.plant.fallen(s, FALL_ANGLE)
        done = on & ~fell & (true.along >= self.end)
        late = on & ((self.steps >= self.most) | (error > LOST))
        self.fallen, self.finished = self.fallen | fell, self.finished | done
        self.going = on & ~(fell | done | late)

    def results(self) -> CourseRides:
        """Return the results of all rides."""
        time = self.steps * self.plant.time_step
        return CourseRides(
            finished=self.finished,
            fallen=self.fallen,
            time=time,
            distance=self.distance,
            rms=np.sqrt(self.square / self.steps),
            largest=self.largest,
            end_error=self.last,
            torque=np.sqrt(self.torque / self.steps),
            peak_lean=self.lean,
            speed=self.distance / time,
        )
