"""Following paths on both plants: the issue's targets, joining, and the speed in turns."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bicycle_controller.control import followers
from bicycle_controller.control.lqr import fitting
from bicycle_controller.control.path import Paths, Place, sampled
from bicycle_controller.control.path_making import path_through
from bicycle_controller.control.speed_profile import CHANGE, speed_profile
from bicycle_controller.evaluation import course_score
from bicycle_controller.evaluation.course_rides import Start, ride_courses
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import FALL_ANGLE, Plant

LIMITS = np.array([2.0, 0.0, 100.0])
WHIPPLE = registry.named(plant="whipple", bicycle="browser-rider")


@pytest.fixture(scope="module")
def ridden() -> dict[str, dict[str, Any]]:
    results, _ = course_score.score("preview", "all", WHIPPLE)
    return {item["course"]: item for item in results}


def test_every_course_is_ridden_to_its_end(ridden: dict[str, dict[str, Any]]) -> None:
    for name, item in ridden.items():
        assert item["falls"] == item["unfinished"] == 0, name
        assert item["largest_m"] < 1.0, name


@pytest.mark.parametrize("name", ["straight", "circle-20"])
def test_straight_and_circle_within_10_cm(ridden: dict[str, dict[str, Any]], name: str) -> None:
    assert ridden[name]["rms_m"] <= 0.10
    assert ridden[name]["largest_m"] <= 0.3


def test_the_lane_change_at_5_m_s_overshoots_less_than_30_cm() -> None:
    results, traces = course_score.score("preview", "lane-change", WHIPPLE)
    trace = traces[0][1]
    assert results[0]["speed_m_s"] == pytest.approx(5.0, abs=0.2)
    assert trace.y.max() - 3.5 < 0.3
    assert trace.y.min() > -0.3
    assert abs(results[0]["end_error_m"]) < 0.05


@pytest.mark.parametrize("plant", [registry.default(), WHIPPLE], ids=["choi", "whipple"])
def test_random_roads_are_ridden_and_joined_from_beside_them(plant: Plant[Any]) -> None:
    results, _ = course_score.score("preview", "random", plant, 40, seed=5, start=(3.0, 0.8))
    assert results[0]["falls"] == 0
    assert results[0]["unfinished"] <= 1
    assert results[0]["rms_m"] < 2.0


def test_a_loop_that_is_joined_half_way_round_is_ridden_whole() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 8000)  # an eight that crosses itself at a right angle
    loop = sampled(30.0 * np.sin(angle), 15.0 * np.sin(2.0 * angle), closed=True)
    turned = Start(np.zeros(1), np.array([0.5 * np.pi]))
    follower = followers.make("preview", WHIPPLE)
    rides, _ = ride_courses(follower, WHIPPLE, [loop], [3.0], start=turned)
    assert rides.finished.all()
    assert rides.distance[0] == pytest.approx(loop.length, rel=0.05)


def test_preview_beats_stanley() -> None:
    (preview, stanley), _ = zip(
        *(course_score.score(name, "slalom", WHIPPLE) for name in ("preview", "stanley")),
        strict=True,
    )
    assert stanley[0]["falls"] == 0
    assert preview[0]["rms_m"] < 0.5 * stanley[0]["rms_m"]


def test_the_speed_falls_before_a_turn_and_rises_after_it() -> None:
    follower = followers.make("preview", registry.default())
    s = np.linspace(0.0, 120.0, 6001)
    bend = np.where((s > 55.0) & (s < 65.0), 1.0 / 5.0, 0.0)
    yaw = np.cumsum(bend) * 0.02
    path = sampled(np.cumsum(np.cos(yaw)) * 0.02, np.cumsum(np.sin(yaw)) * 0.02)
    speed = speed_profile(path, 4.0, follower.sharpest)
    middle = speed[int(60.0 / path.spacing)]
    assert speed[0] == speed[-1] == pytest.approx(4.0)
    assert follower.sharpest(np.array([middle]))[0] >= 1.0 / 5.0
    assert 2.0 <= middle < 3.0
    assert np.abs(np.diff(speed**2) / (2.0 * path.spacing)).max() <= CHANGE + 1e-9


def test_an_unknown_follower_names_the_nearest() -> None:
    with pytest.raises(ValueError, match="did you mean 'stanley'"):
        followers.make("stanly", WHIPPLE)


def largest_kick_caught(plant: Plant[Any], speed: float, follows: bool) -> float:
    """Return the largest lean rate, rad/s, from which a ride along +y does not fall in 10 s."""
    kicks = np.arange(0.1, 1.6, 0.025)
    count, nothing = len(kicks), np.zeros(len(kicks))
    line = path_through([(0.0, 0.0), (0.0, 300.0)], closed=False)
    paths, follower = Paths([line], np.zeros(count, int)), followers.make("preview", plant)
    fallback, wanted = fitting(LIMITS, plant), np.full(count, speed)
    state = plant.initial(nothing, nothing + 5.0, nothing, wanted)
    state, fallen = plant.pushed(state, kicks), np.zeros(count, bool)
    for _ in range(400):
        steer = [state.steer_angle, state.steer_rate]
        lean = [state.lean_angle, state.lean_rate, state.lean_acceleration]
        seen = np.column_stack([*steer, *lean, -state.heading])
        if follows:
            place = Place(state.rear_y, -state.rear_x, state.heading, nothing)
            action = follower.act(seen, state.speed, place, paths, wanted)
        else:
            action = fallback.act(seen, state.speed)
        torque, _, pedal = np.clip(action, -LIMITS, LIMITS).T
        state = plant.step(state, torque, nothing, pedal, (1.0, 8.0))
        fallen |= plant.fallen(state, FALL_ANGLE)
    return float(kicks[~fallen].max())


@pytest.mark.parametrize("plant", [registry.default(), WHIPPLE], ids=["choi", "whipple"])
@pytest.mark.parametrize("speed", [2.0, 3.0, 4.0])
def test_it_catches_the_kicks_that_the_fallback_catches(plant: Plant[Any], speed: float) -> None:
    """So the safety layer does not take a path from it for its lean."""
    own, fallback = (largest_kick_caught(plant, speed, follows) for follows in (True, False))
    assert own >= 0.95 * fallback > 0.3
