"""Orders that a guide carries out: paths, arrivals in a direction, cmd_vel, what follows a goal.

A follower's gains and a path's smoothing take longer than a control period, so they are made in
threads; `poll`, called with every state in the loop's thread, takes up what is ready.
"""

from __future__ import annotations

import math
import queue
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from bicycle_common.geometry import heading_to_yaw
from bicycle_common.types import BicycleState, Point2D
from bicycle_controller.control import followers
from bicycle_controller.control.arrival import RUN_IN, arrival_path, circle_path
from bicycle_controller.control.control_loop import ControlLoop
from bicycle_controller.control.courses import Course
from bicycle_controller.control.guide import PathEnd, PathReport
from bicycle_controller.control.keep_clear import Mover
from bicycle_controller.control.path import Path
from bicycle_controller.control.path_follower import PathFollower
from bicycle_controller.control.path_ride import PathRide
from bicycle_controller.control.twist_ride import TwistLimits, TwistRide
from bicycle_sim.plants.base import Plant

MakeCourse = Callable[[float], Course]
"""Returns a course for a bicycle that turns with a radius, m; it may raise ValueError."""
RESERVE = 0.8
"""Share of the largest curvature that a path planned here uses."""
ROOM = 0.5
"""m before the circle around a goal from where on it counts as reached on the path to it."""
STRAIGHT_ON = 2000.0
"""m of the straight path on which a bicycle slows down."""
AFTER = ("hold", "circle", "slow")
"""Choices after the last goal: ride straight on, circle it, or ride on at the lowest speed."""


@dataclass(frozen=True)
class GuidanceConfig:
    """Settings of how orders are carried out."""

    follower: str = "preview"
    """Follower's name, one of `followers.FOLLOWERS`."""
    speed: float = 3.0
    """m/s of paths that name none."""
    slowest: float = 2.0
    """m/s, lowest speed."""
    after_goal: str = "hold"
    """Action after the last goal, one of AFTER."""
    twist: TwistLimits = field(default_factory=TwistLimits)
    """Limits of cmd_vel."""


class Guidance:
    """Guides of one bicycle.

    Attributes:
        config: settings; may be replaced at any time, the follower alone stays.
        log_lines: lines for the log, not yet written.
        followed: the path that has just begun; None if it was taken.
    """

    def __init__(self, loop: ControlLoop, config: GuidanceConfig) -> None:
        """Give `loop` guides; no follower is made before `ride`."""
        self._loop, self.config = loop, config
        self._follower: PathFollower | None = None
        self._limits = np.full(3, np.inf)
        self._key: object = None
        self._ready: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._waiting: list[tuple[int, str, MakeCourse, int, float]] = []
        self._next_id = 1
        self._newest = 0
        self._ride: PathRide | None = None
        self._reports: list[PathReport] = []
        self._ticks = 0
        self._twist: TwistRide | None = None
        self._snapshot: BicycleState | None = None
        self._arrival: tuple[Point2D, float] | None = None
        self._arriving: tuple[PathRide, float] | None = None
        self._wanted: tuple[Point2D, float] | None = None
        self._unable = ""
        self.others: dict[str, Mover] = {}
        """Other bicycles to keep clear of on paths, by name."""
        self.name = ""
        """Own name among them."""
        self.log_lines: list[str] = []
        self.followed: Path | None = None

    def ride(self, plant: Plant[Any], limits: np.ndarray) -> None:
        """Prepare to guide a bicycle; limits (3,) of |T|, |d| and |F|, N m, m, N."""
        key = plant, tuple(limits)
        if key == self._key:
            return
        self._key, self._limits, self._follower, self._unable = key, limits, None, ""
        self._snapshot = None  # of the bicycle before, at another speed perhaps
        torque = float(limits[0]) if math.isfinite(limits[0]) else 2.0
        pedal = float(limits[2]) if math.isfinite(limits[2]) else 100.0

        def make() -> None:
            try:
                with np.errstate(all="ignore"):
                    new_follower = followers.make(self.config.follower, plant, torque, pedal)
            except (ValueError, ArithmeticError, TypeError) as error:
                text = f"this bicycle can follow no path: {error}"
                self._ready.put(lambda: self._take_follower(key, None, text))
                return
            self._ready.put(lambda: self._take_follower(key, new_follower, ""))

        threading.Thread(target=make, daemon=True).start()

    def _take_follower(self, key: object, follower: PathFollower | None, unable: str) -> None:
        if key != self._key:
            return
        self._follower, self._unable = follower, unable

    @property
    def ready(self) -> bool:
        """True once the follower's gains are computed, or it is known that there are none."""
        return self._follower is not None or bool(self._unable)

    @property
    def _may_begin(self) -> bool:
        """True if paths can be judged: without a pedal the speed decides how sharply it turns."""
        return bool(self._unable) or (self._follower is not None and self._snapshot is not None)

    @property
    def _pedals(self) -> bool:
        return bool(self._limits[2] > 0.0)

    def _radius(self) -> float:
        """Return the radius that a path may turn with, m."""
        assert self._follower is not None
        assert self._snapshot is not None
        if self._pedals:
            return followers.tightest(self._follower, self.config.slowest)
        # Without a pedal the speed stays what it is.
        return 1.0 / float(self._follower.sharpest(np.array([self._snapshot.speed]))[0])

    def follow(self, name: str, make: MakeCourse, laps: int = 0, speed: float = 0.0) -> int:
        """Follow a path instead of all goals and paths; return its number.

        Args:
            name: of the course, for reports.
            make: returns the path; called in a thread.
            laps: of a loop; zero takes the course's.
            speed: m/s; zero takes the course's.
        """
        number, self._next_id = self._next_id, self._next_id + 1
        self._newest = number
        order = number, name, make, laps, speed
        if self._may_begin:
            self._begin(*order)
        else:
            self._waiting.append(order)
        return number

    def _begin(self, number: int, name: str, make: MakeCourse, laps: int, speed: float) -> None:
        if self._follower is None:
            self._refuse(number, name, self._unable)
            return
        follower, radius, slowest = self._follower, self._radius(), self.config.slowest

        def work() -> None:
            try:
                course = make(radius)
                asked = speed or course.speed
                course = replace(course, laps=laps or course.laps, speed=max(asked, slowest))
                ride = PathRide(follower, course, number, slowest)
            except (ValueError, ArithmeticError, OSError) as error:
                text = str(error)
                self._ready.put(lambda: self._refuse(number, name, text))
                return
            self._ready.put(lambda: self._take_path(ride))

        threading.Thread(target=work, daemon=True).start()

    def _refuse(self, number: int, name: str, why: str) -> None:
        nothing = (0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, math.nan, math.nan, 0.0)
        self._reports.append(PathReport(number, name, PathEnd.REJECTED, *nothing, why))
        self.log_lines.append(f"path {number} {name} rejected: {why}")

    def _take_path(self, ride: PathRide) -> None:
        if ride.path_id != self._newest:
            ride.end(PathEnd.REPLACED, "a newer order came")
            self._reports.append(ride.report())
            return
        self._loop.tracker.cancel("a path is followed instead")
        self._steer(ride)
        path = ride.course.path
        text = f"path {ride.path_id} {ride.course.name}: {ride.length:.0f} m"
        text += f", sharpest turn {1.0 / path.sharpest:.1f} m" if path.sharpest > 1e-3 else ""
        self.log_lines += [text, *path.notes]

    def _steer(self, ride: PathRide) -> None:
        self._finish()
        self._loop.steer_by(ride)
        ride.others, ride.name = self.others, self.name
        self._ride, self._twist = ride, None
        self.followed = ride.course.path

    def stop(self, why: str, status: PathEnd = PathEnd.REPLACED) -> None:
        """Stop the active guide, for a goal or on request."""
        self._newest, self._arrival, self._arriving, self._wanted = 0, None, None, None
        self._loop.tracker.on_the_way = False
        for number, name, *_ in self._waiting:
            nothing = (0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, math.nan, math.nan, 0.0)
            self._reports.append(PathReport(number, name, status, *nothing, why))
        self._waiting = []
        if self._loop.guide is not None:
            self._loop.guide.end(status, why)
        self._finish()
        self._loop.steer_by(None)
        self._twist = None
        if self._snapshot is not None and not self._loop.tracker.steers:
            self._loop.tracker.hold(self._snapshot.heading)

    def arrive(self, goals: Sequence[Point2D], yaw: float) -> str:
        """Ride to goals, which the tracker has, and arrive at the last one in a direction.

        Returns:
            Why it cannot arrive so; empty if it can.
        """
        if self._unable:
            return self._unable
        self._wanted = goals[-1], yaw
        if len(goals) > 1 or self._follower is None or self._snapshot is None:
            self._arrival = goals[-1], yaw
        else:
            self._approach(goals[-1], yaw)
        return ""

    def arrival_at(self, goal: Point2D) -> float | None:
        """Return the yaw with which a goal is to be reached, rad; None for any."""
        is_last = self._wanted is not None and self._wanted[0] == goal
        return self._wanted[1] if self._wanted is not None and is_last else None

    def _approach(self, goal: Point2D, yaw: float) -> None:
        """Ride to a goal on a path that arrives in a direction."""
        assert self._follower is not None
        assert self._snapshot is not None
        now = self._snapshot
        here = now.rear_x, now.rear_y, float(heading_to_yaw(now.heading))
        speed = max(self.config.speed if self._pedals else now.speed, self.config.slowest)
        radius = 1.0 / (RESERVE * float(self._follower.sharpest(np.array([speed]))[0]))
        path = arrival_path(here, (*goal, yaw), radius)
        course = Course("arrival", path, speed)
        number, self._next_id = self._next_id, self._next_id + 1
        self._newest = number
        ride = PathRide(self._follower, course, number, from_start=True)
        self._steer(ride)
        self._arriving = ride, path.length - RUN_IN - self._loop.tracker.radius - ROOM
        self._look_at_arrival()

    def _look_at_arrival(self) -> None:
        """Let the goal count as reached only near the end of the path that arrives at it."""
        tracker = self._loop.tracker
        if self._arriving is None:
            tracker.on_the_way = False
            return
        ride, enough = self._arriving
        on = self._loop.guide is ride and not ride.over and ride.along < enough
        tracker.on_the_way = on
        if not on:
            self._arriving = None

    def after_goal(self, goal: Point2D) -> str:
        """Start what follows the last goal; return its description, empty for nothing."""
        after = self.config.after_goal
        if after == "hold" or self._follower is None or self._snapshot is None:
            return "" if after == "hold" else "rides straight on: it can follow no path"
        now = self._snapshot
        speed = self.config.slowest if self._pedals else max(now.speed, self.config.slowest)
        if after == "circle":
            radius = 1.0 / (RESERVE * float(self._follower.sharpest(np.array([speed]))[0]))
            here = now.rear_x, now.rear_y
            path = circle_path(goal, max(radius, 4.0), here)
            course = Course("circle", path, speed, laps=100_000)
            text = f"circles the goal at {max(radius, 4.0):.1f} m"
        else:
            path = _straight_on(now)
            course = Course("slow", path, speed)
            text = f"rides straight on and slows down to {speed:.1f} m/s"
            if not self._pedals:
                text = "rides straight on; without a pedal it cannot slow down"
        number, self._next_id = self._next_id, self._next_id + 1
        self._newest = number
        self._steer(PathRide(self._follower, course, number))
        return text

    def twist(self, speed: float, yaw_rate: float) -> None:
        """Take a command of cmd_vel, m/s and rad/s, positive to the left.

        Raises:
            ValueError: if it is not finite, or no follower can ride it.
        """
        if self._follower is None:
            raise ValueError(self._unable or "the follower's gains are not computed yet")
        if self._twist is None or self._loop.guide is not self._twist:
            twist = TwistRide(self._follower, self.config.twist)
            twist.command(speed, yaw_rate)
            self._newest = 0
            self._finish()
            self._loop.tracker.cancel("cmd_vel steers instead")
            self._loop.steer_by(twist)
            self._twist, self._ride = twist, None
            self.log_lines.append("cmd_vel steers")
        self._twist.limits = self.config.twist
        self._twist.command(speed, yaw_rate)

    def poll(self, snapshot: BicycleState) -> None:
        """Take up what the threads have finished, before a state is answered."""
        self._snapshot = snapshot
        while not self._ready.empty():
            self._ready.get()()
        if self._waiting and self._may_begin:
            waiting, self._waiting = self._waiting, []
            for order in waiting:
                self._begin(*order)
        self._look_at_arrival()
        tracker = self._loop.tracker
        if self._arrival is not None and tracker.has_goal and tracker.waiting == 0:
            goal, yaw = self._arrival
            if self._unable:
                self._arrival = self._wanted = None
                self.log_lines.append(f"arrives in any direction: {self._unable}")
            elif self._follower is not None:
                self._arrival = None
                self._approach(goal, yaw)

    def reports(self) -> list[PathReport]:
        """Return the reports to publish after a state was answered."""
        self._ticks += 1
        ride = self._ride
        if ride is not None and ride.over:
            self._finish()
            if self._loop.guide is ride:
                self._loop.steer_by(None)
                if self._snapshot is not None and not self._loop.tracker.steers:
                    self._loop.tracker.hold(self._snapshot.heading)
        elif ride is not None and self._ticks % 4 == 0:
            self._reports.append(ride.report())
        found, self._reports = self._reports, []
        return found

    @property
    def path(self) -> PathReport | None:
        """Progress along the followed path; None without one."""
        return self._ride.report() if self._ride is not None else None

    def _finish(self) -> None:
        """Report the end of the path that was followed."""
        if self._ride is None:
            return
        self._ride.end(PathEnd.REPLACED, "a newer order came")
        report, self._ride = self._ride.report(), None
        self._reports.append(report)
        self.log_lines.append(
            f"path {report.path_id} {report.name} {report.status.name.lower()}: {report.message}"
        )


def _straight_on(now: BicycleState) -> Path:
    from bicycle_controller.control.path_making import path_through

    ahead = STRAIGHT_ON
    end = now.rear_x - ahead * math.sin(now.heading), now.rear_y + ahead * math.cos(now.heading)
    return path_through([(now.rear_x, now.rear_y), end], closed=False)
