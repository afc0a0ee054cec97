"""Paths, arrivals, cmd_vel and what follows a goal, in the loop and without ROS."""

from __future__ import annotations

import math
import threading
import time
from typing import Any

import numpy as np
import pytest

from bicycle_common.geometry import heading_to_yaw, wrap_angle
from bicycle_common.types import Command, InitialPose
from bicycle_controller.control import courses, followers
from bicycle_controller.control.control_loop import ControlLoop
from bicycle_controller.control.courses import Course
from bicycle_controller.control.goals import GoalTracker, Status
from bicycle_controller.control.guidance import Guidance, GuidanceConfig
from bicycle_controller.control.guide import PathEnd, PathReport
from bicycle_controller.control.lqr import LqrController
from bicycle_controller.control.path import sampled
from bicycle_controller.control.path_making import Rounding, path_through
from bicycle_controller.control.safety import Safety
from bicycle_controller.control.twist_ride import TwistLimits
from bicycle_sim.plants import registry
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named

WHIPPLE = registry.named(plant="whipple", bicycle="browser-rider")
LIMITS = np.array([2.0, 0.0, 100.0])


class Ride:
    """A simulator, a loop and its guidance, without processes."""

    def __init__(
        self, plant: Any = WHIPPLE, start: InitialPose | None = None, **config: Any
    ) -> None:
        self.simulator = Simulator(named("learned-speed"), plant)
        self.simulator.reset(start or InitialPose(0.0, 0.0, -math.pi / 2, 3.0))  # towards +x
        policy = LqrController(plant=plant)
        self.loop = ControlLoop("test", policy, GoalTracker(), LIMITS)
        self.guidance = Guidance(self.loop, GuidanceConfig(**config))
        self.guidance.ride(plant, LIMITS)
        self.reports: list[PathReport] = []
        self.events: list[Any] = []
        deadline = time.monotonic() + 60.0
        while self.guidance._follower is None:
            assert time.monotonic() < deadline
            self.guidance.poll(self.simulator.snapshot)
            time.sleep(0.01)

    def settle(self) -> None:
        """Wait for threads: a path is made in one."""
        deadline = time.monotonic() + 60.0
        while self.guidance._ready.empty():
            assert time.monotonic() < deadline
            time.sleep(0.005)

    def step(self, push: float = 0.0) -> None:
        snapshot = self.simulator.snapshot
        self.guidance.poll(snapshot)
        out = self.loop.answer(snapshot, snapshot.step * 0.025)
        self.events += out.events
        self.reports += self.guidance.reports()
        command = out.command or Command(snapshot.episode, snapshot.step, 0.0, 0.0, 0.0)
        self.simulator.step(command, push)

    def until(self, condition: Any, most: int = 8000) -> None:
        for _ in range(most):
            if condition():
                return
            assert not self.simulator.snapshot.fallen
            self.step()
        raise AssertionError(f"not within {most} steps")

    @property
    def yaw(self) -> float:
        return float(heading_to_yaw(self.simulator.snapshot.heading))


def course(*points: tuple[float, float], speed: float = 3.0) -> Any:
    return lambda radius: Course(
        "made", path_through(points, rounding=Rounding(radius, max(6.0, radius))), speed
    )


def test_a_path_is_joined_followed_and_ended() -> None:
    ride = Ride()
    number = ride.guidance.follow("made", course((10.0, 3.0), (60.0, 3.0)))
    ride.settle()
    ride.until(lambda: any(one.status is PathEnd.FINISHED for one in ride.reports))
    last = ride.reports[-1]
    assert last.path_id == number
    assert last.rms < 0.3
    assert any(one.status is PathEnd.ACTIVE for one in ride.reports)
    assert ride.loop.guide is None
    assert ride.loop.tracker.steers  # it rides straight on


@pytest.mark.parametrize(
    ("ahead", "aside", "status"),
    [(60.0, 0.0, PathEnd.LOST), (30.0, 8.0, PathEnd.LOST), (0.5, 0.0, PathEnd.FINISHED)],
)
def test_a_path_that_lies_behind_is_not_called_ridden(
    ahead: float, aside: float, status: PathEnd
) -> None:
    """A bicycle at the path's end has ridden it; one that is far beyond has not."""
    ride = Ride(start=InitialPose(50.0 + ahead, aside, -math.pi / 2, 3.0))
    ride.guidance.follow("made", course((0.0, 0.0), (50.0, 0.0)))
    ride.settle()
    ride.until(lambda: any(one.status is not PathEnd.ACTIVE for one in ride.reports), 200)
    (last,) = (one for one in ride.reports if one.status is not PathEnd.ACTIVE)
    assert last.status is status
    if status is PathEnd.LOST:
        away = math.hypot(ahead, aside)
        assert last.message.startswith(f"its end is the nearest place, {away:.1f} m away")
        assert math.isnan(last.rms)
    ride.step()
    assert ride.loop.tracker.steers  # it rides straight on


@pytest.mark.parametrize("laps", [1, 2])
@pytest.mark.parametrize("before", [4.0, 40.0])
def test_a_loop_is_ridden_whole_from_wherever_it_is_joined(laps: int, before: float) -> None:
    back = before / 20.0  # rad of a circle that begins at the origin, towards +x
    start = InitialPose(
        -20.0 * math.sin(back), 20.0 - 20.0 * math.cos(back), -math.pi / 2 - back, 3.0
    )
    ride = Ride(start=start)
    angle = np.linspace(0.0, 2.0 * math.pi, 4000)
    loop = sampled(20.0 * np.sin(angle), 20.0 - 20.0 * np.cos(angle), closed=True)
    ride.guidance.follow("circle", lambda radius: Course("circle", loop, 3.0), laps)
    ride.settle()
    steps = ride.simulator.snapshot.step
    ride.until(lambda: any(one.status is PathEnd.FINISHED for one in ride.reports))
    ridden = 3.0 * 0.025 * (ride.simulator.snapshot.step - steps)
    lap = 40.0 * math.pi
    assert ridden == pytest.approx(laps * lap, rel=0.05)
    told = [one for one in ride.reports if one.laps == laps]
    assert (told[0].lap, told[-1].lap) == (1, laps)
    assert told[0].along < 3.0
    assert told[-1].along == pytest.approx(laps * lap, abs=0.5)
    assert all(0.0 <= one.along < one.lap * lap + 0.5 for one in told)
    assert f"lap {laps} of {laps}" in told[-2].message


def test_a_goal_ends_a_path_and_a_path_ends_a_goal() -> None:
    ride = Ride()
    ride.guidance.follow("made", course((0.0, 0.0), (200.0, 0.0)))
    ride.settle()
    ride.until(lambda: ride.loop.guide is not None)
    ride.guidance.stop("a newer goal came")
    ride.loop.tracker.replace([(100.0, 20.0)])
    ride.until(lambda: ride.loop.tracker.has_goal)
    assert ride.loop.guide is None
    assert ride.reports[-1].status is PathEnd.REPLACED
    ride.guidance.follow("made", course((0.0, 0.0), (200.0, 0.0)))
    ride.settle()
    ride.until(lambda: ride.loop.guide is not None)
    ride.until(lambda: not ride.loop.tracker.has_goal)
    assert ride.events[-1].status is Status.CANCELLED


def test_an_order_waits_for_the_speed_without_which_no_turn_can_be_judged() -> None:
    """A bicycle without a pedal keeps its speed; at 5 m/s it cannot turn as at 2 m/s."""
    fixed = np.array([2.0, 0.0, 0.0])
    simulator = Simulator(named("random-start-random-goal"), WHIPPLE)
    simulator.reset(InitialPose(0.0, 0.0, -math.pi / 2, 5.0))
    loop = ControlLoop("test", LqrController(plant=WHIPPLE), GoalTracker(), fixed)
    guidance = Guidance(loop, GuidanceConfig())
    asked: list[float] = []

    def make(radius: float) -> Course:
        asked.append(radius)
        return course((0.0, 0.0), (50.0, 0.0))(radius)

    guidance.ride(WHIPPLE, fixed)
    # The gains are ready before the first state is.
    while guidance._ready.empty():
        time.sleep(0.01)
    guidance._ready.get()()
    assert guidance.ready
    guidance.follow("early", make)
    time.sleep(0.2)
    assert not asked
    guidance.poll(simulator.snapshot)
    guidance.follow("late", make)
    deadline = time.monotonic() + 60.0
    while len(asked) < 2:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert asked[0] == asked[1]
    assert guidance._follower is not None
    assert asked[0] > followers.tightest(guidance._follower, guidance.config.slowest)


def test_a_path_too_sharp_is_refused_with_the_number() -> None:
    ride = Ride()
    ride.guidance.follow("made", course((0.0, 0.0), (3.0, 0.0), (3.0, 3.0), (6.0, 3.0)))
    ride.settle()
    ride.step()
    assert ride.reports[-1].status is PathEnd.REJECTED
    assert "m at least" in ride.reports[-1].message


def test_the_path_before_is_ridden_on_when_the_next_is_refused() -> None:
    ride = Ride()
    first = ride.guidance.follow("first", course((0.0, 0.0), (200.0, 0.0)))
    ride.settle()
    ride.step()
    second = ride.guidance.follow("second", course((0.0, 0.0), (3.0, 0.0), (3.0, 3.0)))
    ride.settle()
    ride.step()
    ends = [(one.path_id, one.status) for one in ride.reports if one.status is not PathEnd.ACTIVE]
    assert ends == [(second, PathEnd.REJECTED)]
    assert ride.guidance.path is not None
    assert ride.guidance.path.path_id == first
    ride.guidance.cancel(first, "asked for")
    ride.step()
    assert (ride.reports[-1].path_id, ride.reports[-1].status) == (first, PathEnd.CANCELLED)
    assert ride.loop.guide is None


def test_a_cancel_while_the_path_is_being_made_is_told_as_one() -> None:
    ride, made = Ride(), threading.Event()
    old = ride.guidance.follow("old", course((0.0, 0.0), (200.0, 0.0)))
    ride.settle()
    ride.step()

    def slowly(radius: float) -> Course:
        assert made.wait(60.0)
        return Course("slow", path_through([(0.0, 0.0), (100.0, 0.0)]), 3.0)

    number = ride.guidance.follow("slow", slowly)
    ride.guidance.cancel(number, "asked for")
    made.set()
    ride.settle()
    for _ in range(8):
        ride.step()
    ends = [one for one in ride.reports if one.status is not PathEnd.ACTIVE]
    assert [(one.path_id, one.status, one.message) for one in ends] == [
        (number, PathEnd.CANCELLED, "asked for")
    ]
    assert ride.guidance.path is not None
    assert ride.guidance.path.path_id == old  # it was not asked to end


def test_a_path_that_cannot_be_made_for_any_reason_is_refused() -> None:
    ride = Ride()

    def broken(radius: float) -> Course:
        raise KeyError("no such thing")

    number = ride.guidance.follow("broken", broken)
    ride.settle()
    ride.step()
    (report,) = ride.reports
    assert (report.path_id, report.status) == (number, PathEnd.REJECTED)
    assert report.message == "KeyError 'no such thing'"


@pytest.mark.parametrize("plant", [registry.default(), WHIPPLE], ids=["choi", "whipple"])
def test_arrivals_within_10_degrees(plant: Any) -> None:
    ride, rng = Ride(plant), np.random.default_rng(4)
    off = []
    for _ in range(12):
        here = ride.simulator.snapshot
        goal = here.rear_x + rng.uniform(-30, 30), here.rear_y + rng.uniform(-30, 30)
        yaw = float(rng.uniform(-math.pi, math.pi))
        ride.guidance.stop("a newer goal came")
        ride.loop.tracker.replace([goal])
        assert ride.guidance.arrive([goal], yaw) == ""
        ride.events.clear()
        ride.until(lambda: any(one.status is Status.REACHED for one in ride.events))
        off.append(abs(float(wrap_angle(ride.yaw - yaw))))
    assert np.mean(np.array(off) < math.radians(10.0)) >= 0.9


@pytest.mark.parametrize("yaw", [0.5 * math.pi, math.pi])
def test_a_bicycle_faster_than_its_paths_arrives_as_asked(yaw: float) -> None:
    """It slows down little by little, and needs wider turns until then."""
    ride = Ride(start=InitialPose(0.0, 0.0, -math.pi / 2, 4.5))
    ride.step()
    ride.loop.tracker.replace([(1.0, 0.0)])
    assert ride.guidance.arrive([(1.0, 0.0)], yaw) == ""
    ride.events.clear()
    ride.until(lambda: any(one.status is Status.REACHED for one in ride.events))
    assert abs(float(wrap_angle(ride.yaw - yaw))) < math.radians(5.0)


def test_after_the_last_goal_it_circles_or_slows_down() -> None:
    ride = Ride(after_goal="circle")
    assert "circles the goal at" in ride.guidance.after_goal((10.0, 0.0))
    for _ in range(1600):
        ride.step()
    here = ride.simulator.snapshot
    radius = math.hypot(here.rear_x - 10.0, here.rear_y)
    report = ride.guidance.path
    assert report is not None
    assert radius == pytest.approx(report.length / report.laps / (2.0 * math.pi), abs=0.5)

    ride = Ride(after_goal="slow", slowest=2.5)
    assert "slows down to 2.5 m/s" in ride.guidance.after_goal((10.0, 0.0))
    for _ in range(400):
        ride.step()
    assert ride.simulator.snapshot.speed == pytest.approx(2.5, abs=0.1)


def watched(follower: str = "preview") -> Ride:
    """A ride with the safety layer and the LQR as its fallback, as in the node."""
    ride = Ride(follower=follower)
    ride.loop.fallback = LqrController(plant=WHIPPLE)
    ride.loop.safety = Safety(None, WHIPPLE)
    return ride


@pytest.mark.parametrize(
    ("follower", "name"),
    [("preview", "slalom"), ("preview", "circle-10"), ("learned", "circle-10")],
)
def test_the_turns_of_a_path_are_no_reason_to_hand_over(follower: str, name: str) -> None:
    """A measured bicycle's turns are further from riding straight than the layer's limit."""
    ride = watched(follower)
    ride.guidance.follow(name, lambda radius: courses.load(name, radius))
    ride.settle()
    ride.until(lambda: any(one.status is PathEnd.FINISHED for one in ride.reports))
    assert ride.loop.handed_over == 0
    assert ride.reports[-1].rms < 0.1


def test_cmd_vel_turns_both_ways_without_a_hand_over() -> None:
    ride = watched()
    for sign in (1.0, -1.0, 1.0):
        for _ in range(240):
            ride.guidance.twist(3.0, sign * 0.25)
            ride.step()
            assert not ride.simulator.snapshot.fallen
    assert ride.loop.handed_over == 0


def test_a_kick_takes_a_path_from_a_network_and_leaves_it_its_speed() -> None:
    ride = watched("learned")
    ride.guidance.follow("made", course((10.0, 0.0), (300.0, 0.0), speed=3.5))
    ride.settle()
    for _ in range(200):
        ride.step()
    assert ride.loop.handed_over == 0
    ride.step(push=0.7)
    for _ in range(30):
        ride.step()
        assert ride.loop.handed_over > 0
    assert ride.simulator.snapshot.speed == pytest.approx(3.5, abs=0.15)
    ride.until(lambda: not ride.loop.driving)
    assert not ride.simulator.snapshot.fallen


def test_a_figure_eight_by_cmd_vel_alone_and_its_time_out() -> None:
    ride = Ride()
    rates, turned, before = [], 0.0, ride.yaw
    for sign in (1.0, -1.0):
        turned = 0.0
        for _ in range(3000):
            ride.guidance.twist(2.5, sign * 0.25)
            ride.step()
            assert not ride.simulator.snapshot.fallen
            turned += float(wrap_angle(ride.yaw - before))
            before = ride.yaw
            if sign * turned >= 2.0 * math.pi:
                break
        assert sign * turned >= 2.0 * math.pi
        rates.append(ride.simulator.snapshot.speed)
    assert rates == pytest.approx([2.5, 2.5], abs=0.1)
    for _ in range(200):  # nothing more comes: straight on
        ride.step()
    before = ride.yaw
    for _ in range(40):
        ride.step()
    assert abs(wrap_angle(ride.yaw - before)) < 0.02


def test_cmd_vel_is_limited_to_what_the_bicycle_rides() -> None:
    ride = Ride(twist=TwistLimits(slowest=2.0, fastest=4.0, yaw_rate=0.5))
    for _ in range(400):
        ride.guidance.twist(0.0, 5.0)
        ride.step()
    snapshot = ride.simulator.snapshot
    assert snapshot.speed == pytest.approx(2.0, abs=0.15)
    assert not snapshot.fallen
    with pytest.raises(ValueError, match="finite"):
        ride.guidance.twist(math.nan, 0.0)
