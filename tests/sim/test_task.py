"""Starts, ends and seeds of the batched task."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from state_maker import rows

from bicycle_sim.plants.choi.parameters import Physics
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import Region, Scenario, named
from bicycle_sim.task.task import BicycleTask

RANDOM = named("random-start-random-goal")


def corridor(goals: list[float], max_steps: int = 400) -> BicycleTask:
    """Return bicycles at the origin that head along +y to goals so many metres away."""
    count = len(goals)
    scenario = Scenario(
        "corridor", Region.point(0.0, 0.0), Region.point(0.0, 50.0), max_steps=max_steps
    )
    task = BicycleTask(scenario, count=count, rng=np.random.default_rng(0))
    zero = np.zeros(count)
    task.place(np.ones(count, dtype=bool), zero, zero, zero, zero, np.array(goals))
    return task


def test_reaching_terminates_and_the_limit_truncates() -> None:
    task = corridor([2.0, 50.0], max_steps=20)
    for number in range(1, 21):
        step = task.step(np.zeros((2, 3)))
        reached = number * 0.025 * 10.0 / 3.6 >= 1.0
        assert step.terminated.tolist() == [reached and number * 0.025 * 10.0 / 3.6 <= 3.0, False]
    # The bicycle that reached its goal rolls on unless the caller resets it, and the two ends
    # exclude each other.
    assert step.truncated.tolist() == [False, True]
    assert not (step.terminated & step.truncated).any()


def test_falling_never_terminates() -> None:
    task = corridor([50.0, 50.0])
    task.state = replace(task.state, lean_angle=np.array([0.0, 0.6]))
    before = rows(task.state)[:, 1].copy()
    first = task.step(np.zeros((2, 3)))
    assert first.fallen.tolist() == [False, True]
    lying = rows(task.state)[:, 1].copy()
    assert not np.array_equal(before, lying)  # The step of the fall is still taken.
    second = task.step(np.ones((2, 3)))
    np.testing.assert_array_equal(rows(task.state)[:, 1], lying)
    assert second.reward[1] == first.reward[1]
    assert not second.terminated.any()
    assert task.state.rear_y[0] > first.observation.shape[0] * 0.05  # The other rides on.


@pytest.mark.parametrize("compiled", [True, False])
def test_a_bicycle_that_falls_into_the_goal_has_not_reached_it(compiled: bool) -> None:
    task = corridor([1.0])
    if not compiled:
        task._native = None
    task.state = replace(task.state, lean_angle=np.array([0.6]))
    step = task.step(np.zeros((1, 3)))
    assert task.goal_distance()[0] < 1.0
    assert step.fallen[0]
    assert not step.terminated[0]


def test_reset_of_some_leaves_the_others() -> None:
    task = BicycleTask(RANDOM, count=5, rng=np.random.default_rng(3))
    for _ in range(10):
        task.step(np.full((5, 3), 0.1))
    mask = np.array([True, False, False, True, False])
    before, goals = rows(task.state).copy(), task.goal_x.copy()
    task.reset(mask)
    after = rows(task.state)
    np.testing.assert_array_equal(after[:, ~mask], before[:, ~mask])
    np.testing.assert_array_equal(task.goal_x[~mask], goals[~mask])
    assert (after[0, mask] == 0.0).all()
    assert (task.goal_x[mask] != goals[mask]).all()
    assert task.steps.tolist() == [0, 10, 10, 0, 10]


def test_reset_leaves_the_last_step_as_it_was() -> None:
    task = corridor([50.0])
    task.state = replace(task.state, lean_angle=np.array([0.6]))
    step = task.step(np.zeros((1, 3)))
    reward = step.reward[0]
    task.reset()
    assert step.fallen[0]
    assert step.reward[0] == reward != 0.0


def test_reset_wakes_a_fallen_bicycle() -> None:
    task = corridor([50.0])
    task.state = replace(task.state, lean_angle=np.array([0.6]))
    task.step(np.zeros((1, 3)))
    task.reset()
    assert not task.fallen[0]
    step = task.step(np.zeros((1, 3)))
    assert not step.fallen[0]
    assert step.reward[0] == pytest.approx(-2.0 * step.observation[0, 5] ** 2)


def test_reset_of_none_draws_nothing() -> None:
    task = BicycleTask(RANDOM, count=2, rng=np.random.default_rng(3))
    before = task.rng.bit_generator.state
    task.reset(np.zeros(2, dtype=bool))
    assert task.rng.bit_generator.state == before


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_seed_repeats_to_the_bit_and_another_does_not(noise: float) -> None:
    def ride(seed: int) -> np.ndarray:
        task = BicycleTask(
            RANDOM, ChoiPlant(Physics(displacement_noise=noise)), 4, np.random.default_rng(seed)
        )
        for _ in range(30):
            task.step(np.full((4, 3), 0.05))
        return np.concatenate([rows(task.state), task.observation().T])

    np.testing.assert_array_equal(ride(1), ride(1))
    assert not np.array_equal(ride(1), ride(2))


def test_the_reward_is_the_sum_of_its_terms() -> None:
    task = BicycleTask(RANDOM, count=50, rng=np.random.default_rng(5))
    for _ in range(80):  # Long enough for falls.
        step = task.step(np.tile([2.0, 0.2, 0.0], (50, 1)))
        np.testing.assert_allclose(step.reward, sum(step.terms.values()), rtol=1e-12)
    assert step.fallen.any()


def test_results_are_the_callers() -> None:
    task = corridor([50.0])
    first = task.step(np.array([[2.0, 0.0, 0.0]]))
    snapshot = task.snapshot()
    kept = first.observation.copy(), first.reward.copy(), rows(snapshot).copy()
    task.step(np.array([[-2.0, 0.1, 0.0]]))
    np.testing.assert_array_equal(first.observation, kept[0])
    np.testing.assert_array_equal(first.reward, kept[1])
    np.testing.assert_array_equal(rows(snapshot), kept[2])


@pytest.mark.parametrize(
    ("action", "words"),
    [
        (np.zeros(3), r"shape \(2, 3\), not \(3,\)"),
        (np.zeros((2, 2)), r"shape \(2, 3\), not \(2, 2\)"),
        (np.array([[0.0, np.nan, 0.0], [0.0, 0.0, 0.0]]), "not finite"),
        (np.full((2, 3), np.inf), "not finite"),
    ],
)
def test_impossible_actions_are_refused(action: np.ndarray, words: str) -> None:
    task = corridor([50.0, 50.0])
    before = rows(task.state).copy()
    with pytest.raises(ValueError, match=words):
        task.step(action)
    np.testing.assert_array_equal(rows(task.state), before)


def test_no_bicycles_are_refused() -> None:
    with pytest.raises(ValueError, match="at least one bicycle, not 0"):
        BicycleTask(RANDOM, count=0)
