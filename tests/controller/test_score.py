"""Order of policies by their scores in training."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bicycle_controller.config.run import EvaluationConfig
from bicycle_controller.evaluation.score import Score, score, shaken
from bicycle_controller.policy.policy import load_controller
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import SCENARIOS

SCENARIO = SCENARIOS["random-start-random-goal"]
GOOD = Score(reach_rate=1.0, fall_rate=0.0, orbit_rate=0.0, median_time_s=40.0)


class Nothing:
    """Leaves the bicycle alone, which falls within a second or two."""

    policy_id = "nothing"

    def act(self, observation: np.ndarray, speed: np.ndarray) -> np.ndarray:
        return np.zeros((len(observation), 3))


def test_falls_under_noise_outweigh_a_shorter_time() -> None:
    sooner = replace(GOOD, median_time_s=30.0)
    assert sooner.rank > GOOD.rank
    brittle = replace(sooner, shaken_fall_rate=0.1)
    assert brittle.rank < replace(GOOD, shaken_fall_rate=0.0).rank == GOOD.rank


def test_shaking_is_repeatable_and_tells_the_lqr_from_nothing() -> None:
    lqr = load_controller("lqr")
    assert shaken(lqr, SCENARIO, ChoiPlant(), 0.05, seed=1, steps=200) == 0.0
    rough = shaken(lqr, SCENARIO, ChoiPlant(), 0.5, seed=1, steps=200)
    assert rough == shaken(lqr, SCENARIO, ChoiPlant(), 0.5, seed=1, steps=200) > 0.5
    assert shaken(Nothing(), SCENARIO, ChoiPlant(), 0.05, seed=1, steps=200) == 1.0


@pytest.mark.parametrize("sigma", [0.0, 0.05])
def test_a_score_is_shaken_only_where_the_evaluation_says_so(sigma: float) -> None:
    fixed = EvaluationConfig(episodes=8, max_steps=100, shake=sigma)
    found = score(load_controller("lqr"), SCENARIO, ChoiPlant(), fixed)
    assert found.shaken_fall_rate == (0.0 if sigma else None)
    assert found.mean_return is not None
    assert found.mean_return < 0
