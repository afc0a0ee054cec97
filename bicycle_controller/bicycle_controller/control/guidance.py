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

from bicycle_common.geometry import heading_to_yaw, wrap_angle
from bicycle_common.types import BicycleState, Point2D
from bicycle_common.validation import one_line
from bicycle_controller.control import followers
from bicycle_controller.control.arrival import RUN_IN, arrival_path, circle_path
from bicycle_controller.control.control_loop import ControlLoop
from bicycle_controller.control.courses import Course
from bicycle_controller.control.guide import PathEnd, PathReport
from bicycle_controller.control.keep_clear import Mover
from bicycle_controller.control.path import Path
from bicycle_controller.control.path_follower import PathFollower
from bicycle_controller.control.path_ride import PathRide
from bicycle_controller.control.swerve import Swerve
from bicycle_controller.control.twist_ride import TwistLimits, TwistRide
from bicycle_sim.plants.base import Plant

MakeCourse = Callable[[float], Course]
"""Returns a course for a bicycle that turns with a radius, m; it may raise ValueError."""
RESERVE = 0.8
"""Share of the largest curvature that a path planned here uses."""
SPEEDS_OF_ARRIVAL = 9
"""Speeds, from the present one to the wanted one, whose turns an arrival compares."""
ROOM = 0.5
"""m before the circle around a goal from where on it counts as reached on the path to it."""
STRAIGHT_ON = 2000.0
"""m of the straight path on which a bicycle slows down."""
AFTER = ("hold", "circle", "slow")
"""Choices after the last goal: ride straight on, circle it, or ride on at the lowest speed."""


NEWER = "a newer order came"
"""Reason of an order that another one replaces."""


@dataclass
class _Pending:
    """An order to follow a path that is not ridden yet."""

    number: int
    name: str
    make: MakeCourse
    laps: int
    speed: float
    begun: bool = False
    """True once its path is being made."""


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
        self._pending: _Pending | None = None
        self._next_id = 1
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
        """Other bicycles to keep clear of, by name."""
        self.name = ""
        """Own name among them."""
        loop.swerve = Swerve(self.others)
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
            except Exception as error:  # whatever it is, orders must not wait for ever
                text = f"this bicycle can follow no path: {_told(error)}"
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
        self._drop(PathEnd.REPLACED, NEWER)
        self._pending = _Pending(number, name, make, laps, speed)
        if self._may_begin:
            self._begin(self._pending)
        return number

    def _begin(self, order: _Pending) -> None:
        order.begun = True
        number = order.number
        if self._follower is None:
            self._refuse(number, self._unable)
            return
        follower, radius, slowest = self._follower, self._radius(), self.config.slowest

        def work() -> None:
            try:
                course = order.make(radius)
                asked = order.speed or course.speed
                laps = order.laps or course.laps
                course = replace(course, laps=laps, speed=max(asked, slowest))
                ride = PathRide(follower, course, number, slowest)
            except Exception as error:  # whatever it is, the order must end
                text = _told(error)
                self._ready.put(lambda: self._refuse(number, text))
                return
            self._ready.put(lambda: self._take_path(ride))

        threading.Thread(target=work, daemon=True).start()

    def _drop(self, status: PathEnd, why: str) -> None:
        """End an order whose path is not ridden yet."""
        order, self._pending = self._pending, None
        if order is not None:
            self._reports.append(unridden(order.number, order.name, status, why))
            text = f"path {order.number} {order.name} {status.name.lower()}: {why}"
            self.log_lines.append(text)

    def _is_pending(self, number: int) -> bool:
        return self._pending is not None and self._pending.number == number

    def _refuse(self, number: int, why: str) -> None:
        if self._is_pending(number):
            self._drop(PathEnd.REJECTED, why)

    def _take_path(self, ride: PathRide) -> None:
        if not self._is_pending(ride.path_id):
            return  # its end is told already
        self._pending = self._arrival = None
        self._loop.tracker.cancel("a path is followed instead")
        self._steer(ride)
        path = ride.course.path
        text = f"path {ride.path_id} {ride.course.name}: {ride.length:.0f} m"
        text += f", sharpest turn {1.0 / path.sharpest:.1f} m" if path.sharpest > 1e-3 else ""
        self.log_lines += [text, *path.notes]

    def _steer(self, ride: PathRide) -> None:
        self._finish()
        self._loop.steer_by(ride)
        ride.others, ride.name, ride.pedals = self.others, self.name, self._pedals
        self._ride, self._twist = ride, None
        self.followed = ride.course.path

    def cancel(self, number: int, why: str) -> None:
        """Cancel the path of a number, or with zero what is ridden otherwise.

        A path that is not ridden yet and another order that still is do not end one another.
        """
        if number and self._is_pending(number):
            self._drop(PathEnd.CANCELLED, why)
        elif not number or (self._ride is not None and self._ride.path_id == number):
            self._stop_riding(why, PathEnd.CANCELLED)

    def stop(self, why: str, status: PathEnd = PathEnd.REPLACED) -> None:
        """Stop the active guide, and drop a path that is not ridden yet."""
        self._drop(status, why)
        self._stop_riding(why, status)

    def _stop_riding(self, why: str, status: PathEnd) -> None:
        self._arrival = self._arriving = self._wanted = None
        self._loop.tracker.on_the_way = False
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

    def off(self, yaw: float) -> float:
        """Return the heading of the newest state less `yaw`, rad; NaN without a state."""
        if self._snapshot is None:
            return math.nan
        return float(wrap_angle(float(heading_to_yaw(self._snapshot.heading)) - yaw))

    def _approach(self, goal: Point2D, yaw: float) -> None:
        """Ride to a goal on a path that arrives in a direction."""
        assert self._follower is not None
        assert self._snapshot is not None
        now = self._snapshot
        here = now.rear_x, now.rear_y, float(heading_to_yaw(now.heading))
        speed = max(self.config.speed if self._pedals else now.speed, self.config.slowest)
        # A bicycle that is faster yet needs its wider turns: it slows down little by little.
        speeds = np.linspace(speed, max(speed, now.speed), SPEEDS_OF_ARRIVAL)
        radius = 1.0 / (RESERVE * float(self._follower.sharpest(speeds).min()))
        path = arrival_path(here, (*goal, yaw), radius)
        course = Course("arrival", path, speed)
        number, self._next_id = self._next_id, self._next_id + 1
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
            twist.swerve = Swerve(self.others, self.name)
            twist.swerve.pedals = self._pedals
            twist.command(speed, yaw_rate)
            self._drop(PathEnd.REPLACED, "cmd_vel steers instead")
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
        self._loop.swerve.name, self._loop.slowest = self.name, self.config.slowest
        while not self._ready.empty():
            self._ready.get()()
        if self._pending is not None and not self._pending.begun and self._may_begin:
            self._begin(self._pending)
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
        self._ride.end(PathEnd.REPLACED, NEWER)
        report, self._ride = self._ride.report(), None
        self._reports.append(report)
        self.log_lines.append(
            f"path {report.path_id} {report.name} {report.status.name.lower()}: {report.message}"
        )


def unridden(number: int, name: str, status: PathEnd, why: str) -> PathReport:
    """Return the report of a path that ended before it was ridden."""
    nothing = (0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, math.nan, math.nan, 0.0)
    return PathReport(number, name, status, *nothing, why)


def _told(error: Exception) -> str:
    """Return an error in one line, with its kind where the text alone would not tell it."""
    expected = isinstance(error, (ValueError, OSError)) and str(error)
    return one_line(str(error) if expected else f"{type(error).__name__} {error}".strip())


def _straight_on(now: BicycleState) -> Path:
    from bicycle_controller.control.path_making import path_through

    ahead = STRAIGHT_ON
    end = now.rear_x - ahead * math.sin(now.heading), now.rear_y + ahead * math.cos(now.heading)
    return path_through([(now.rear_x, now.rear_y), end], closed=False)
