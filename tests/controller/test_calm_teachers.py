"""Two regulators for each bicycle: which of them rides, and how rarely they fall."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bicycle_common.geometry import wrap_angle
from bicycle_controller.config import loading
from bicycle_controller.config.imitation import CalmConfig, ImitationConfig
from bicycle_controller.training.bicycle_park import teachers_of
from bicycle_controller.training.calm_teachers import CalmTeachers
from bicycle_controller.training.teachers import COMMANDS, Seen, Teachers
from bicycle_sim.plants.whipple import random_bicycles
from bicycle_sim.plants.whipple.plant import WhipplePlant

COUNT = 48


def own() -> ImitationConfig:
    found = loading.preset("sure-any-bicycle").imitation
    assert found is not None
    return found


def late_bicycles() -> WhipplePlant:
    """Return random bicycles: 7 N m, 30 ms of lag, 75 ms of delay, nothing that brakes."""
    ranges = random_bicycles.Ranges(
        torque_limit=(7.0, 7.0), delay=(0.075, 0.075), motor_lag=(0.03, 0.03), friction=(0.0, 0.0),
        damping=(0.0, 0.0), grade=(0.0, 0.0), wind=(0.0, 0.0), plain_share=0.0,
    )  # fmt: skip
    drawn = random_bicycles.draw(COUNT, np.random.default_rng(5), ranges, 3)
    return WhipplePlant(replace(drawn, resistance=type(drawn.resistance)()))


@pytest.fixture(scope="module")
def plant() -> WhipplePlant:
    return late_bicycles()


@pytest.fixture(scope="module")
def teachers(plant: WhipplePlant) -> CalmTeachers:
    found, _ = teachers_of(plant, np.full(COUNT, 7.0), own())
    assert isinstance(found, CalmTeachers)
    return found


def answers(teachers: CalmTeachers, lean_rate: float) -> list[np.ndarray]:
    """Return the torques of both together, of the calm one and of the quick one."""
    zero = np.zeros(COUNT)
    seen = Seen(
        zero, zero + lean_rate, zero + 0.02, zero, zero, zero + 2.0, zero,
        np.zeros((COUNT, COMMANDS)),
    )  # fmt: skip
    return [who.act(seen) for who in (teachers, teachers.calm, teachers.quick)]


def test_the_calm_one_rides_alone_until_a_kick(teachers: CalmTeachers) -> None:
    both, calm, quick = answers(teachers, 0.005)
    np.testing.assert_array_equal(both, calm)
    assert np.abs(calm - quick).max() > 0.1
    both, _, quick = answers(teachers, 20.0)
    np.testing.assert_array_equal(both, quick)


def test_between_them_their_torques_are_blended(teachers: CalmTeachers) -> None:
    both, calm, quick = answers(teachers, 0.15)
    low, high = np.minimum(calm, quick), np.maximum(calm, quick)
    assert np.all((low - 1e-12 <= both) & (both <= high + 1e-12))
    assert np.any((low + 1e-6 < both) & (both < high - 1e-6))


def test_they_fall_less_in_turns_than_those_that_catch_kicks(plant: WhipplePlant) -> None:
    shipped = loading.preset("any-bicycle").imitation
    assert shipped is not None
    fallen = []
    for config in (own(), shipped):
        found, _ = teachers_of(plant, np.full(COUNT, 7.0), config)
        fallen.append(turning_falls(plant, found))
    assert fallen[0] <= 1
    assert fallen[1] >= 5


def turning_falls(plant: WhipplePlant, who: Teachers | CalmTeachers) -> int:
    """Return how many fall when the wanted heading jumps thrice, at 1.5 m/s, without noise."""
    rng, zero = np.random.default_rng(3), np.zeros(COUNT)
    state, wanted = plant.initial(zero, zero, zero, zero + 1.5), zero
    commands = np.zeros((COUNT, COMMANDS))
    upright = np.ones(COUNT, dtype=bool)
    for period in range(480):
        if period % 160 == 0:
            wanted = wanted + rng.uniform(-np.pi / 2, np.pi / 2, COUNT)
        torque = who.act(Seen.of(state, wrap_angle(state.heading - wanted), commands))
        commands = np.column_stack([torque, commands[:, :-1]])
        state = plant.step(state, torque, zero, zero)
        upright &= (np.abs(state.lean_angle) < np.pi / 6) & (np.abs(state.steer_angle) < np.pi / 3)
    return int((~upright).sum())


def test_a_range_that_does_not_grow_is_refused() -> None:
    calm = own().calm
    assert calm is not None
    with pytest.raises(ValueError, match=r"imitation\.calm\.end must be above"):
        CalmConfig(calm.weights, begin=0.8, end=0.8)
