"""Distances and words of a fleet's report."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bicycle_bringup.fleet_report import FleetMember, as_text, facts, least_distance


def rider(name: str, times: np.ndarray, x: np.ndarray, y: np.ndarray) -> FleetMember:
    return FleetMember(name, track=list(zip(times, x, y, strict=True)))


def test_the_least_distance_is_that_of_one_moment() -> None:
    east, north = np.arange(0.0, 10.0, 0.3), np.arange(0.1, 9.0, 0.7)
    one = rider("b1", east, 3.0 * east - 15.0, 0.0 * east)
    # Both cross the origin, the other one 2 s later.
    other = rider("b2", north, 0.0 * north, 3.0 * north - 21.0)
    assert least_distance(one, other) == pytest.approx(6.0 / math.sqrt(2.0), abs=0.01)
    assert facts([one, other])["nearest_m"] == least_distance(one, other)
    assert facts([one, other])["nearest_pair"] == ["b1", "b2"]


def test_bicycles_that_did_not_ride_together_have_no_distance() -> None:
    early, late = np.arange(0.0, 1.0, 0.1), np.arange(5.0, 6.0, 0.1)
    one, other = rider("b1", early, early, early), rider("b2", late, late, late)
    assert least_distance(one, other) == math.inf
    assert least_distance(one, FleetMember("b3")) == math.inf
    assert facts([one, other])["nearest_m"] is None
    assert "nearest – m" in as_text(facts([one, other]))


def test_a_report_tells_the_nearest_pair_and_the_latest_steps() -> None:
    riders = [
        FleetMember("b1", "ridden to its end", True, 0.1, 0.2, lateness=[0.001] * 99 + [0.01])
    ]
    riders.append(FleetMember("b2"))
    for one, x in zip(riders, (0.0, 2.5), strict=True):
        one.track = [(0.0, x, 1.0), (1.0, x, 2.0)]
    found = facts(riders)
    assert (found["finished"], found["nearest_m"], found["nearest_pair"]) == (1, 2.5, ["b1", "b2"])
    assert found["bicycles"]["b1"]["lateness_p99_ms"] == pytest.approx(1.09, abs=0.1)
    assert {"command", "commit", "processor", "dropped_steps"} <= found.keys()
    assert "1 of 2 rode their routes to the end; nearest 2.50 m (b1 and b2)" in as_text(found)
