"""Random bicycles are bicycles, are all different, and lie within their ranges."""

from __future__ import annotations

import numpy as np
import pytest

from bicycle_sim.plants.whipple import random_bicycles
from bicycle_sim.plants.whipple.linear import eigenvalues
from bicycle_sim.plants.whipple.plant import WhipplePlant
from bicycle_sim.plants.whipple.random_bicycles import Ranges, draw


def test_the_same_seed_draws_the_same() -> None:
    one, other = (draw(50, np.random.default_rng(3)) for _ in range(2))
    assert WhipplePlant(one).to_json() == WhipplePlant(other).to_json()
    assert len(np.unique(one.bicycle.w)) == 50


def test_they_lie_within_the_ranges() -> None:
    p = draw(2000, np.random.default_rng(1))
    ranges = Ranges()
    for values, (low, high) in (
        (p.bicycle.w, ranges.wheelbase),
        (p.bicycle.c, ranges.trail),
        (90.0 - np.degrees(p.bicycle.lam), ranges.head_angle),
        (p.delay, ranges.delay),
        (p.motor.lag, ranges.motor_lag),
        (p.motor.limit, ranges.torque_limit),
        (p.steering.friction, ranges.friction),
    ):
        assert low <= np.min(values) < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < np.max(values) <= high
    mass = np.asarray(p.bicycle.mass)
    ridden = mass > ranges.mass[1]
    assert 0.45 < ridden.mean() < 0.55
    for values in (p.motor.lag, p.steering.friction, p.road.grade_x):
        assert 0.2 < np.mean(np.equal(values, 0.0)) < 0.3
    periods = np.asarray(p.delay) / p.time_step
    assert 0.2 < np.mean(np.isclose(periods, np.rint(periods), atol=1e-9)) < 0.3
    assert mass.max() < ranges.mass[1] + ranges.rider_mass[1]


def test_they_behave_like_bicycles() -> None:
    """They fall when slow, and most balance themselves at some speed or nearly so."""
    bicycle = draw(300, np.random.default_rng(2)).bicycle
    slow = eigenvalues(bicycle, 1.0)[:, 0].real
    assert (slow > 0.5).all()
    assert np.percentile(slow, 95) < 8.0
    fastest = np.array([eigenvalues(bicycle, v)[:, 0].real for v in (4.0, 5.0, 6.0, 7.0)]).min(0)
    assert np.mean(fastest < 0.5) > 0.8


def test_a_range_that_shrinks_is_told() -> None:
    with pytest.raises(ValueError, match="wheelbase must not shrink"):
        Ranges(wheelbase=(1.2, 1.0))
    with pytest.raises(ValueError, match="delay must be zero or more"):
        Ranges(delay=(-0.1, 0.1))
    with pytest.raises(ValueError, match="rider_share"):
        Ranges(rider_share=2.0)


def test_joined_bodies_keep_mass_and_moments() -> None:
    """Two equal point masses 2 m apart: mass 2 in their middle, 1 kg m^2 each about it."""
    one = dict.fromkeys(("Ixx", "Iyy", "Izz", "Ixz"), np.zeros(1))
    left = one | {"m": np.ones(1), "x": np.zeros(1), "z": -np.ones(1)}
    right = one | {"m": np.ones(1), "x": 2.0 * np.ones(1), "z": -np.ones(1)}
    body = random_bicycles._joined(left, right)
    found = {name: float(value[0]) for name, value in body.items()}
    expected = {"m": 2.0, "x": 1.0, "z": -1.0, "Ixx": 0.0, "Iyy": 2.0, "Izz": 2.0, "Ixz": 0.0}
    assert found == pytest.approx(expected)
