"""A goal with a heading: the path to it, and the direction in which real rides arrive."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from bicycle_controller.control.arrival import arrival_path
from bicycle_controller.evaluation import arrivals
from bicycle_sim.plants import registry
from bicycle_sim.task.scenario import named

WHIPPLE = registry.named(plant="whipple", bicycle="browser-rider")


def test_a_path_ends_in_the_direction_asked_for() -> None:
    path = arrival_path((0.0, 0.0, 0.0), (5.0, 3.0, math.pi), 4.0)
    at = int(np.argmin(np.hypot(path.x - 5.0, path.y - 3.0)))
    assert path.heading[at] == pytest.approx(math.pi / 2, abs=0.02)  # psi counts from +y
    assert path.sharpest < 1.1 / 4.0


@pytest.mark.parametrize("plant", [registry.default(), WHIPPLE], ids=["choi", "whipple"])
def test_random_poses_are_reached_in_the_direction_asked_for(plant: Any) -> None:
    found = arrivals.score(plant, named("learned-speed"), poses=12, seed=3)
    assert found["reached"] == found["possible"] == 12
    assert found["within_10_degrees"] > 0.9
    assert "within 10° of the direction asked for" in arrivals.as_text(found)
