"""Equation 20, term by term."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bicycle_sim.task.reward import RewardWeights, reward_terms

numbers = st.floats(-1e3, 1e3)


def test_worked_by_hand() -> None:
    terms = reward_terms(0.2, -1.5, 4.0, math.pi / 2, RewardWeights())
    assert terms == pytest.approx(
        {
            "lean_angle": -0.04,
            "lean_rate": -0.225,
            "lean_acceleration": -0.16,
            "heading_error": -(math.pi**2) / 2,
        }
    )


@given(numbers, numbers, numbers, numbers)
def test_never_positive_and_even(lean: float, rate: float, bend: float, error: float) -> None:
    terms = reward_terms(lean, rate, bend, error, RewardWeights())
    assert all(value <= 0.0 for value in terms.values())
    assert terms == reward_terms(-lean, -rate, -bend, -error, RewardWeights())


def test_straight_and_upright_costs_nothing() -> None:
    zero = np.zeros(3)
    terms = reward_terms(zero, zero, zero, zero, RewardWeights())
    assert not any(value.any() for value in terms.values())


def test_balance_ignores_the_goal() -> None:
    balance = RewardWeights.balance()
    assert reward_terms(0.1, 0.2, 0.3, 3.0, balance)["heading_error"] == 0.0


@pytest.mark.parametrize("name", ["lean_angle", "heading_error"])
@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_impossible_weights_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name} must be zero or more"):
        RewardWeights(**{name: value})
