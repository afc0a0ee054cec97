"""Shortest paths with a bounded radius."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bicycle_controller.control.arrival import arrival_path, circle_path
from bicycle_controller.control.dubins import points, shortest


def test_every_path_ends_where_and_as_it_should() -> None:
    rng = np.random.default_rng(7)
    for _ in range(500):
        start = (*rng.uniform(-20.0, 20.0, 2), rng.uniform(-4.0, 4.0))
        end = (*rng.uniform(-20.0, 20.0, 2), rng.uniform(-4.0, 4.0))
        segments = shortest(start, end, 4.0)
        x, y = points(start, segments, 4.0)
        turned = sum({"L": 1, "S": 0, "R": -1}[kind] * part / 4.0 for kind, part in segments)
        off = (start[2] + turned - end[2] + math.pi) % (2.0 * math.pi) - math.pi
        assert math.hypot(x[-1] - end[0], y[-1] - end[1]) < 1e-6
        assert abs(off) < 1e-6
        assert sum(part for _, part in segments) >= math.hypot(
            end[0] - start[0], end[1] - start[1]
        )


def test_straight_ahead_is_straight() -> None:
    ((kind, length),) = shortest((0.0, 0.0, 0.0), (10.0, 0.0, 0.0), 3.0)
    assert kind == "S"
    assert length == pytest.approx(10.0)


def test_an_arrival_passes_the_goal_in_its_direction_and_turns_no_sharper() -> None:
    path = arrival_path((0.0, 0.0, 0.0), (10.0, 10.0, math.pi), 5.0)
    at = int(np.argmin(np.hypot(path.x - 10.0, path.y - 10.0)))
    assert math.hypot(path.x[at] - 10.0, path.y[at] - 10.0) < 0.1
    assert math.cos(path.heading[at] + math.pi / 2 - math.pi) > 0.999
    assert path.sharpest < 1.03 / 5.0


def test_a_circle_begins_where_the_bicycle_is_nearest() -> None:
    path = circle_path((1.0, 2.0), 6.0, (11.0, 2.0))
    assert (path.x[0], path.y[0]) == (pytest.approx(7.0), pytest.approx(2.0))
    assert path.closed
    assert path.curvature[5:-5] == pytest.approx(1.0 / 6.0, rel=0.02)
