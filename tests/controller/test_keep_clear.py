"""Bicycles keep clear of one another."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bicycle_common.types import Command, InitialPose
from bicycle_controller.control import keep_clear as rule
from bicycle_controller.control.courses import Course
from bicycle_controller.control.followers import make
from bicycle_controller.control.keep_clear import Mover, Way, keep_clear
from bicycle_controller.control.path_making import path_through
from bicycle_controller.control.path_ride import PathRide
from bicycle_sim.plants import registry
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named


def mover(x: float, y: float, yaw: float, speed: float = 3.0) -> Mover:
    return Mover(*(np.array([v]) for v in (x, y, yaw - math.pi / 2, speed)))


def nearest(count: int, seed: int, rule: bool) -> np.ndarray:
    """Least distances, m, of crossings of points that speed up and swerve at limited rates."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(np.radians(20.0), np.pi, count) * rng.choice((-1, 1), count)
    wanted = [rng.uniform(2.5, 4.0, count) for _ in range(2)]
    heading = [np.zeros(count), angle]
    meet = rng.uniform(8.0, 14.0, count)
    late = rng.normal(0.0, 0.8, count)
    along = [-wanted[0] * meet, -wanted[1] * (meet + late)]
    speed = [one.copy() for one in wanted]
    aside, rate = [np.zeros(count), np.zeros(count)], [np.zeros(count), np.zeros(count)]
    least = np.full(count, np.inf)
    for _ in range(300):
        both = []
        for i in range(2):
            fx, fy = -np.sin(heading[i]), np.cos(heading[i])
            x, y = along[i] * fx - aside[i] * fy, along[i] * fy + aside[i] * fx
            both.append(Mover(x, y, heading[i], speed[i]))
        least = np.minimum(least, np.hypot(both[0].x - both[1].x, both[0].y - both[1].y))
        for i in range(2):
            way = Way(wanted[i], np.zeros(count), np.zeros(count, dtype=bool))
            if rule:
                later = np.full(count, i == 1)
                way = keep_clear(both[i], both[1 - i], later, wanted[i], 2.0, aside[i])
            speed[i] = speed[i] + np.clip(way.speed - speed[i], -0.04, 0.04)
            push = np.clip(0.5 * (way.shift - aside[i]) - 1.2 * rate[i], -0.8, 0.8)
            rate[i] = rate[i] + 0.1 * push
            aside[i] = aside[i] + 0.1 * rate[i]
            along[i] = along[i] + 0.1 * speed[i]
    return least


def test_no_collision_in_1000_crossings() -> None:
    assert (nearest(1000, 0, rule=False) < 1.0).mean() > 0.4
    assert nearest(1000, 0, rule=True).min() > 1.0


def test_who_has_the_other_on_its_right_gives_way() -> None:
    left, right = mover(-15.0, 0.0, 0.0), mover(0.0, -15.0, math.pi / 2)
    wanted, no = np.array([3.0]), np.array([False])
    assert keep_clear(left, right, no, wanted, 2.0).yields[0]
    other = keep_clear(right, left, no, wanted, 2.0)
    assert not other.yields[0]
    assert (other.speed[0], other.shift[0]) == (3.0, 0.0)


def test_who_comes_from_behind_gives_way() -> None:
    slow, fast = mover(0.0, 0.0, 0.0, 2.0), mover(-8.0, 0.5, 0.0, 4.0)
    wanted, yes = np.array([4.0]), np.array([True])
    assert keep_clear(fast, slow, ~yes, wanted, 2.0).yields[0]
    assert not keep_clear(slow, fast, yes, np.array([2.0]), 2.0).yields[0]


@pytest.mark.parametrize("late", [0.0, 1.5])
def test_two_whipple_bicycles_cross(late: float) -> None:
    plant = registry.named(plant="whipple", bicycle="browser-rider")
    follower = make("preview", plant)
    ways = [
        ((-36.0, 0.0), (60.0, 0.0), -math.pi / 2),
        ((0.0, -36.0 - 3.0 * late), (0.0, 60.0), 0.0),
    ]
    rides = []
    for number, (start, end, heading) in enumerate(ways):
        simulator = Simulator(named("learned-speed"), plant)
        simulator.reset(InitialPose(*start, heading, 3.0))
        path = PathRide(follower, Course("", path_through([start, end]), 3.0), number + 1)
        path.name = f"b{number}"
        rides.append((simulator, path))
    least = math.inf
    for step in range(900):
        seen = [simulator.snapshot for simulator, _ in rides]
        least = min(
            least, math.hypot(seen[0].rear_x - seen[1].rear_x, seen[0].rear_y - seen[1].rear_y)
        )
        for i, (simulator, path) in enumerate(rides):
            other = seen[1 - i]
            numbers = other.rear_x, other.rear_y, other.heading, other.speed
            path.others = {f"b{1 - i}": Mover(*(np.array([v]) for v in numbers))}
            torque, _, pedal = path.act(seen[i], 0.025 * step)
            state = seen[i]
            simulator.step(Command(state.episode, state.step, float(torque), 0.0, float(pedal)))
            assert not simulator.snapshot.fallen
    assert least > 1.5


def test_many_others_at_once_give_the_orders_of_one_after_another() -> None:
    rng = np.random.default_rng(3)
    count = 400
    x, y = rng.uniform(-15.0, 15.0, (2, count))
    others = Mover(x, y, rng.uniform(-np.pi, np.pi, count), rng.uniform(2.0, 4.0, count))
    own = Mover(*(np.full(count, value) for value in (0.0, 0.0, 0.2, 3.0)))
    later, last = rng.random(count) < 0.5, rng.choice((0.0, -1.5, 1.5), count)
    wanted, beside = np.full(count, 3.0), np.array([0.3])
    together = keep_clear(own, others, later, wanted, 2.0, beside, last)
    assert 20 < int(together.yields.sum()) < 380
    for i in range(count):
        one = slice(i, i + 1)
        alone = keep_clear(
            Mover(*(value[one] for value in own)),
            Mover(*(value[one] for value in others)),
            later[one],
            wanted[one],
            2.0,
            beside,
            last[one],
        )
        np.testing.assert_allclose([v[one] for v in together], alone, rtol=0.0, atol=1e-9)


def test_without_a_conflict_no_ways_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten bicycles share two processors only if most steps cost little."""
    tried: list[float] = []
    miss = rule._miss

    def counted(
        own: Mover, other: Mover, speed: np.ndarray, aside: float
    ) -> tuple[np.ndarray, np.ndarray]:
        tried.append(aside)
        return miss(own, other, speed, aside)

    monkeypatch.setattr(rule, "_miss", counted)
    own = mover(0.0, 0.0, 0.0)
    keep_clear(own, mover(100.0, 100.0, 0.0), np.array([True]), np.array([3.0]), 2.0)
    quiet = len(tried)
    keep_clear(own, mover(8.0, -8.0, math.pi / 2), np.array([True]), np.array([3.0]), 2.0)
    assert quiet == 3
    assert len(tried) > 40
