"""Two plants in one task: each bicycle moves as its own plant moves it."""

from __future__ import annotations

import numpy as np
import pytest

from bicycle_controller.training.mixed_plant import MixedPlant
from bicycle_sim.plants import base, registry
from bicycle_sim.task.scenario import SCENARIOS
from bicycle_sim.task.task import BicycleTask

FIRST, SECOND = registry.named(physics="faithful"), registry.named(physics="corrected")


def test_each_bicycle_moves_as_its_own_plant_does() -> None:
    second = np.array([False, True, False, True, True])
    rng, zero = np.random.default_rng(1), np.zeros(5)
    plant = MixedPlant(FIRST, SECOND, second)
    state = plant.initial(zero, zero, zero, zero + 2.5)
    state.lean_angle, state.steer_angle = rng.normal(0.0, 0.1, (2, 5))
    torque = rng.normal(size=5)
    moved = base.to_array(plant.step(state, torque, zero, zero))
    one, other = (base.to_array(p.step(state, torque, zero, zero)) for p in (FIRST, SECOND))
    np.testing.assert_array_equal(moved, np.where(second[:, None], other, one))
    assert (one[second] != moved[second]).any()


def test_a_task_keeps_each_bicycle_s_plant() -> None:
    task = BicycleTask(
        SCENARIOS["fixed-start-fixed-goal"], MixedPlant(FIRST, SECOND, np.arange(6) % 2 == 1), 6
    )
    task.step(np.zeros((6, 3)))
    task.keep(np.array([False, True, True, True, False, True]))
    assert isinstance(task.plant, MixedPlant)
    assert task.plant.is_second.tolist() == [True, False, True, True]
    task.step(np.zeros((4, 3)))


def test_other_kinds_do_not_mix() -> None:
    with pytest.raises(ValueError, match="of one kind"):
        MixedPlant(FIRST, registry.named("whipple", "browser-rider"), np.zeros(2, dtype=bool))
