"""Routes of a fleet: rideable, different, and crossing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bicycle_bringup.fleet_routes import routes
from bicycle_controller.control import courses, followers
from bicycle_sim.plants import registry


@pytest.mark.parametrize(
    "plant",
    [registry.default(), registry.named(plant="whipple", bicycle="browser-rider")],
    ids=["choi", "whipple"],
)
def test_ten_routes_can_be_ridden_and_cross(plant: Any, tmp_path: Path) -> None:
    tightest = followers.tightest(followers.make("preview", plant))
    drawn = routes(10, seed=0)
    assert len({one.text for one in drawn}) == 10
    paths = [courses.load(str(one.write(tmp_path, tightest))).path for one in drawn]
    east, north = paths[0], paths[1]
    apart = np.hypot(
        east.x[:, None] - north.x[None, ::5], east.y[:, None] - north.y[None, ::5]
    ).min()
    assert apart < 1.0
    assert (paths[0].x[0], paths[0].y[0]) == pytest.approx((drawn[0].x, drawn[0].y), abs=0.01)
