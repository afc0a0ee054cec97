"""The largest kick caught: against figures that others found, and what it depends on."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from bicycle_controller.control.lqr import LqrController
from bicycle_controller.evaluation.kicks import Kicks, Trial, largest
from bicycle_controller.evaluation.lqr_grid import GRID, best, controllers
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.plants.whipple import catalogue
from bicycle_sim.plants.whipple.parameters import Motor
from bicycle_sim.plants.whipple.plant import WhipplePlant

LIMITS = (7.0, 0.0, 0.0)
QUICK = Trial(coarse=10.0, fine=2.0, after=4.0)


@cache
def plant(bicycle: str, delay: float, lag: float) -> WhipplePlant:
    known = catalogue.load(bicycle).parameters
    return WhipplePlant(replace(known, delay=delay, motor=Motor(lag=lag, limit=7.0)))


class Still:
    """Does nothing."""

    policy_id = "still"

    def act(self, observation: np.ndarray, speed: np.ndarray) -> np.ndarray:
        return np.zeros((len(speed), 3))


@pytest.mark.parametrize(
    ("bicycle", "speed", "known"),
    [
        ("benchmark", 1.5, 40.0),
        ("benchmark", 2.0, 60.0),
        ("benchmark", 3.0, 94.0),
        ("browser-rider", 1.5, 28.0),
        ("browser-rider", 3.0, 64.0),
        ("browser-rider", 6.0, 126.0),
    ],
)
def test_an_lqr_catches_what_another_program_found(
    bicycle: str, speed: float, known: float
) -> None:
    """The figures are for a step of delay and 7 N m, with other weights, in steps of 2 deg/s."""
    ridden = plant(bicycle, 0.025, 0.0)
    found = largest(LqrController.named("lqr", ridden), ridden, speed, LIMITS, QUICK)
    assert found.straight[0] == pytest.approx(known, rel=0.1)
    assert found.straight[0] == found.straight[1], "an LQR is alike to both sides"
    assert found.turn[0] < found.turn[1], "into the turn it leans already"
    assert found.caught == min(*found.straight, *found.turn) > 0.0


def test_a_design_that_knows_the_delay_catches_more_at_75_ms() -> None:
    ridden = plant("browser-rider", 0.075, 0.03)
    knows = LqrController.named("lqr", ridden)
    unaware = LqrController.named("lqr", plant("browser-rider", 0.0, 0.0))
    assert largest(knows, ridden, 2.0, LIMITS, QUICK).caught >= 20.0
    assert largest(unaware, ridden, 2.0, LIMITS, QUICK).caught == 0.0


def test_who_does_nothing_catches_nothing_below_the_weave_speed() -> None:
    ridden = plant("benchmark", 0.0, 0.0)
    assert largest(Still(), ridden, 2.0, LIMITS, QUICK).caught == 0.0
    alone = largest(Still(), ridden, 5.0, LIMITS, QUICK)
    assert alone.straight[0] >= 20.0, "between weave and capsize speed it balances itself"


def test_any_plant_is_kicked() -> None:
    found = largest(LqrController(), ChoiPlant(), 10.0 / 3.6, (2.0, 0.0, 0.0), QUICK)
    assert found.caught >= 30.0


def test_the_best_of_the_grid_is_the_best_of_the_grid() -> None:
    ridden, trial = plant("browser-rider", 0.05, 0.03), Trial(coarse=20.0, fine=10.0, after=3.0)
    found = best(ridden, 3.0, LIMITS, trial)
    assert len(controllers(ridden, 7.0)) == len(GRID)
    each = [largest(one, ridden, 3.0, LIMITS, trial).caught for one in controllers(ridden, 7.0)]
    assert found.kicks.caught == max(each) > 0.0
    assert isinstance(found.kicks, Kicks)
    assert set(found.summary()) >= {"speed", "straight", "turn", "caught", "states", "torque"}


def test_bad_trials_are_refused() -> None:
    with pytest.raises(ValueError, match="coarse must be above zero"):
        Trial(coarse=0.0)
    with pytest.raises(ValueError, match="speed must be above zero"):
        largest(Still(), ChoiPlant(), 0.0, LIMITS)
    many = replace(catalogue.load("benchmark").parameters, delay=np.array([0.0, 0.1]))
    with pytest.raises(ValueError, match="one bicycle at a time"):
        largest(Still(), WhipplePlant(many), 2.0, LIMITS)
