"""Routes of a fleet: rideable, different, and crossing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bicycle_bringup.fleet_report import Rider, as_text, facts
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


def test_a_report_tells_the_nearest_pair_and_the_latest_steps() -> None:
    riders = [Rider("b1", "ridden to its end", True, 0.1, 0.2, lateness=[0.001] * 99 + [0.01])]
    riders.append(Rider("b2"))
    found = facts(riders, {("b1", "b2"): 2.5})
    assert (found["finished"], found["nearest_m"], found["nearest_pair"]) == (1, 2.5, ["b1", "b2"])
    assert found["bicycles"]["b1"]["lateness_p99_ms"] == pytest.approx(1.09, abs=0.1)
    assert "1 of 2 rode their routes to the end; nearest 2.50 m (b1 and b2)" in as_text(found)
