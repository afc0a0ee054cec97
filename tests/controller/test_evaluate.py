import json
import math
from dataclasses import replace

import numpy as np
import pytest

from bicycle_controller.evaluation.evaluate import Evaluation, compare, wilson
from bicycle_controller.evaluation.rollouts import Disturbance, Rollouts
from bicycle_controller.evaluation.table import as_markdown, as_text, comparison_as_text
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import SCENARIOS, Region

AHEAD = replace(
    SCENARIOS["fixed-start-fixed-goal"],
    name="ahead",
    start=Region.point(0.0, 0.0),
    goal=Region.point(0.0, 20.0),
    heading_spread=0.0,
)


@pytest.mark.parametrize(
    ("hits", "count", "low", "high"),
    [  # Newcombe 1998, Statistics in Medicine 17:857, Table I, method 3.
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
        (29, 29, 1 - 0.1170, 1.0),
    ],
)
def test_wilson_interval_as_published(hits: int, count: int, low: float, high: float) -> None:
    assert wilson(hits, count) == pytest.approx((low, high), abs=5e-5)


def test_wilson_of_nothing_knows_nothing() -> None:
    assert wilson(0, 0) == (0.0, 1.0)
    with pytest.raises(ValueError, match="3 hits in 2"):
        wilson(3, 2)


def ridden(name: str, steps: list[int], reached: list[bool], fallen: list[bool]) -> Evaluation:
    """Five rides written down by hand."""
    count = len(steps)
    rides = Rollouts(
        reached=np.array(reached),
        fallen=np.array(fallen),
        steps=np.array(steps),
        straight=np.array([11.0, 21.0, 31.0, 1.5, 41.0]),
        path=np.array([10.0, 30.0, 33.0, 4.0, 100.0]),
        winding=np.array([0.0, 0.0, 0.0, 0.0, -13.0]),
        peak_lean=np.array([0.1, 0.2, 0.3, 0.15, 0.05]),
        torque=np.array([1.0, 0.0, 0.0, 0.0, 0.0]),
        displacement=np.zeros(count),
        pedal_force=np.zeros(count),
        score=np.array([-1.0, -2.0, -3.0, -4.0, -5.0]),
    )
    return Evaluation(name, AHEAD, ChoiPlant(), Disturbance(), 0, rides)


FIRST = ridden("first", [100, 200, 300, 40, 360], [True] * 4 + [False], [False] * 5)
SECOND = ridden(
    "second",
    [100, 250, 290, 30, 50],
    [True, True, True, False, False],
    [False, False, False, False, True],
)


def test_summary_worked_by_hand() -> None:
    found = FIRST.summary()
    assert found["reach_rate"] == 0.8
    assert found["timeout_rate"] == found["orbit_rate"] == 0.2, "13 rad is more than two turns"
    assert found["median_time_s"] == pytest.approx(150 * 0.025)
    # Steps 40, 100, 200, 300: the 95 % point lies 0.85 of the way from the third to the fourth.
    assert found["p95_time_s"] == pytest.approx(285 * 0.025)
    # 10 / 10, 30 / 20 and 33 / 30; the fourth starts within two radii of its goal.
    assert found["path_ratio"] == pytest.approx(1.1)
    assert found["path_ratio_mean"] == pytest.approx(1.2)
    assert (found["peak_lean"], found["peak_lean_max"]) == (0.15, 0.3)
    assert found["mean_torque"] == pytest.approx(100 / 1000)
    assert found["mean_speed"] == pytest.approx(177 / 25)
    assert found["mean_return"] == -3.0
    assert json.loads(json.dumps(found)) == json.loads(json.dumps(found))


def test_comparison_worked_by_hand() -> None:
    found = compare(FIRST, SECOND)
    for name, hits in (("first_better", 2), ("equal", 2), ("second_better", 1)):
        assert found.pop(name) == hits
        assert found.pop(f"{name}_share") == hits / 5
        assert found.pop(f"{name}_share_interval") == list(wilson(hits, 5))
    assert found == {
        "controllers": ["first", "second"],
        "episodes": 5,
        "both_reach": 3,
        "only_first_reaches": 1,
        "only_second_reaches": 0,
        "neither_reaches": 1,
        "first_sooner": 1,
        "same_time": 1,
        "second_sooner": 1,
        "median_time_s": [200 * 0.025, 250 * 0.025],
        "time_ratio": pytest.approx(1.0),
        "time_saved_s": 0.0,
        "total_time_ratio": pytest.approx(600 / 640),
    }


def test_ties_are_rides_too() -> None:
    """A share of only those rides that differ once made 92 % of what is 75 % of all."""
    found = compare(FIRST, FIRST)
    assert (found["equal"], found["equal_share"]) == (5, 1.0)
    assert found["first_better_share"] == found["second_better_share"] == 0.0
    text = comparison_as_text(compare(FIRST, SECOND))
    assert "of 5 rides first does better in 2 (40.0 %" in text
    assert "second in 1 (20.0 %" in text
    assert "and 2 (40.0 %, 11.8 to 76.9) are equal" in text
    assert "sooner in 1, as soon in 1 and later in 1" in text
    assert "saves 0 s in the median ride, 0.00 % of the time, and 6.25 % of all the time" in text


def test_comparison_of_different_rides_is_refused() -> None:
    with pytest.raises(ValueError, match="seed"):
        compare(FIRST, replace(SECOND, seed=1))
    moved = replace(SECOND.rides, straight=SECOND.rides.straight + 1.0)
    with pytest.raises(ValueError, match="same starts"):
        compare(FIRST, replace(SECOND, rides=moved))


def test_table_shows_degrees_and_gaps() -> None:
    text = as_text([FIRST.summary(), SECOND.summary()])
    lines = text.splitlines()
    assert len({len(line) for line in lines}) == 1, "columns are aligned"
    assert "80.00 % (37.55 to 96.38)" in text
    assert f"{math.degrees(0.3):.4g} deg" in text
    assert "| reached the goal | 80.00 % (37.55 to 96.38) |" in as_markdown(FIRST.summary())
    nobody = replace(FIRST, rides=replace(FIRST.rides, reached=np.zeros(5, dtype=bool)))
    assert "| time to goal, median | - |" in as_markdown(nobody.summary())
