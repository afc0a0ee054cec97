"""Paths by arc length: where a bicycle is on them, and what cannot be ridden."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bicycle_controller.control.path import Paths, sampled
from bicycle_controller.control.path_making import PathRefusedError, Rounding, check, path_through


def circle(radius: float, turns: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    angle = np.linspace(0.0, 2.0 * math.pi * turns, 4000)
    return radius * np.sin(angle), radius * (1.0 - np.cos(angle))


@pytest.mark.parametrize("closed", [False, True])
def test_a_circle_has_its_radius_and_its_length(closed: bool) -> None:
    path = sampled(*circle(10.0), closed=closed)
    inner = path.curvature[3:-3]
    assert path.length == pytest.approx(20.0 * math.pi, rel=1e-5)
    assert inner == pytest.approx(0.1, rel=0.02)  # positive: it turns to the left
    # The heading is psi, from +y: a path that begins along +x has -90 degrees.
    assert path.heading[0] == pytest.approx(-math.pi / 2, abs=0.01)


def test_a_place_beside_a_circle_is_its_distance_to_the_left() -> None:
    paths = Paths([sampled(*circle(10.0), closed=True)])
    for off in (-2.0, -0.3, 0.0, 0.3, 2.0):  # to the left is inside
        for angle in (0.3, 2.0, 6.2):
            x, y = (10.0 - off) * math.sin(angle), 10.0 - (10.0 - off) * math.cos(angle)
            heading = angle - math.pi / 2 + 0.1
            guess = np.array([10.0 * angle + 0.4])
            place = paths.locate(guess, np.array([x]), np.array([y]), np.array([heading]))
            assert place.cross_track[0] == pytest.approx(off, abs=2e-3)
            assert place.along[0] == pytest.approx(10.0 * angle, abs=2e-3)
            assert place.heading_error[0] == pytest.approx(0.1, abs=2e-3)


def test_laps_of_a_loop_are_counted_and_an_open_path_ends() -> None:
    paths = Paths([sampled(*circle(10.0), closed=True), sampled(*circle(10.0, turns=0.5))])
    along = np.zeros(2)
    for angle in np.arange(0.0, 4.0 * math.pi + 0.3, 0.05):
        x, y = 10.0 * math.sin(angle), 10.0 * (1.0 - math.cos(angle))
        where = np.array([x, x]), np.array([y, y]), np.full(2, angle - math.pi / 2)
        along = paths.locate(along, *where).along
    assert along[0] == pytest.approx(10.0 * angle, abs=0.01)
    assert along[1] <= 10.0 * math.pi + 1e-6


def test_a_loop_is_joined_where_it_runs_in_the_bicycle_s_direction() -> None:
    # A narrow loop: up at x = 0, down at x = 2. The bicycle is nearer to the way down.
    path = path_through([(0, 0), (0, 40), (6, 40), (6, 0)], closed=True)
    joined = Paths([path]).join(np.array([3.3]), np.array([20.0]), np.array([0.0]))
    x, _ = Paths([path]).point(joined)
    assert x[0] == pytest.approx(0.0, abs=0.1)


def test_corners_are_rounded_and_the_cut_is_told() -> None:
    path = path_through([(0, 0), (20, 0), (20, 20)], rounding=Rounding(tightest=3.0, widest=4.0))
    assert path.sharpest == pytest.approx(1.0 / 3.62, rel=0.02)  # 1.5 m of cut
    assert "cut by 1.50 m" in path.notes[0]
    assert "90°" in path.notes[0]
    check(path, 3.0)


def test_a_path_sharper_than_the_bicycle_rides_is_refused_with_both_numbers() -> None:
    with pytest.raises(PathRefusedError, match=r"radius of 0\.50 m.*3\.00 m at least"):
        path_through([(0, 0), (1, 0), (1, 1), (2, 1)], rounding=Rounding(tightest=3.0))
    with pytest.raises(PathRefusedError, match=r"radius of 2\.0\d m.*3\.00 m"):
        check(sampled(*circle(2.0)), 3.0)
    with pytest.raises(PathRefusedError, match="180°"):
        path_through([(0, 0), (10, 0), (0, 0)])
    with pytest.raises(PathRefusedError, match="rounding is off"):
        path_through([(0, 0), (20, 0), (20, 20)], rounding=Rounding(refuse=True))


@pytest.mark.parametrize("beyond", [0.0, 0.1])
def test_a_turn_straight_back_is_refused_wherever_the_path_ends(beyond: float) -> None:
    """Points on the line between the first and the last one are not left out beyond its ends."""
    with pytest.raises(PathRefusedError, match=r"180° at \(100\.0, 0\.0\).*2\.50 m at least"):
        path_through([(0, 0), (50, beyond), (100, 0), (60, beyond), (10, 0)])


def test_a_loop_may_repeat_its_first_point_at_its_end() -> None:
    triangle = [(0, 0), (40, 0), (20, 30)]
    once = path_through(triangle, closed=True)
    assert path_through([*triangle, (0, 0)], closed=True).length == once.length
    for two in ([(0, 0), (40, 0), (0, 0)], [(0, 0), (40, 0)]):
        with pytest.raises(PathRefusedError, match="a loop needs three different points"):
            path_through(two, closed=True)


def test_dense_points_of_a_curve_keep_its_shape() -> None:
    angle = np.linspace(0.0, 2.0 * math.pi, 41)[:-1]
    points = [(8.0 * math.cos(a), 8.0 * math.sin(a)) for a in angle]
    path = path_through(points, closed=True)
    radius = np.hypot(path.x, path.y)
    assert path.notes == ()
    assert radius == pytest.approx(8.0, abs=0.05)
    assert path.sharpest == pytest.approx(1.0 / 8.0, rel=0.05)


def test_points_that_jitter_are_ridden_as_the_line_they_mean() -> None:
    rng = np.random.default_rng(3)
    points = [(0.1 * i, float(rng.normal(0.0, 0.03))) for i in range(300)]
    path = path_through(points)
    assert path.sharpest < 0.1
    assert np.abs(path.y).max() < 0.25


@pytest.mark.parametrize("points", [[], [(1.0, 1.0)], [(1.0, 1.0), (1.0, 1.0)], [(0, math.nan)]])
def test_points_that_make_no_path_are_refused(points: list[tuple[float, float]]) -> None:
    with pytest.raises(PathRefusedError):
        path_through(points)
