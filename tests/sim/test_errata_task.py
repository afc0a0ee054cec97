"""Rows 23 to 40 of the errata table: goals, falls, observations, rewards; see test_errata.py."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bicycle_common import geometry
from bicycle_common.observation import ACTION_FIELDS, OBSERVATION_FIELDS
from bicycle_sim.plants.choi import dynamics
from bicycle_sim.plants.choi.linear import steady_lean
from bicycle_sim.plants.choi.parameters import Constants
from bicycle_sim.task.reward import RewardWeights, reward_terms
from bicycle_sim.task.scenario import Region, Scenario, named
from bicycle_sim.task.task import BicycleTask

K = Constants()
TEN_KM_H = 10.0 / 3.6


@pytest.mark.parametrize(
    ("goal", "heading", "expected"),
    [
        ((10.0, 0.0), 0.0, math.pi / 2),  # to the right
        ((-10.0, 0.0), 0.0, -math.pi / 2),
        ((0.0, 10.0), 0.5, 0.5),  # turned left, so it lies to the right
        ((0.0, -10.0), 0.0, math.pi),  # behind: pi, never -pi
        ((0.0, -10.0), -3.0, math.pi - 3.0),
        ((-10.0, -0.001), -math.pi / 2, math.pi - 1e-4),
        ((-10.0, 0.001), -math.pi / 2, -math.pi + 1e-4),
    ],
)
def test_row_23_heading_error(goal: tuple[float, float], heading: float, expected: float) -> None:
    at = np.zeros(1)
    found = geometry.heading_error(at + heading, at, at, at + goal[0], at + goal[1])
    assert found.item() == pytest.approx(expected, abs=1e-8)
    assert -math.pi < found.item() <= math.pi


def test_row_23_is_taken_at_the_rear_contact() -> None:
    task = placed_task(goal=(1.0, 0.0))
    assert task.observation()[0, 5] == pytest.approx(math.pi / 2)
    task.state.front_x += 100.0
    assert task.observation()[0, 5] == pytest.approx(math.pi / 2)


def test_row_24_a_fall_is_beyond_30_degrees() -> None:
    limit = math.pi / 6
    lean = np.array([limit, np.nextafter(limit, 1.0), -limit, -np.nextafter(limit, 1.0)])
    assert dynamics.fallen(lean).tolist() == [False, True, False, True]


def test_row_25_a_fall_freezes_and_its_reward_repeats() -> None:
    task = placed_task(goal=(0.0, 100.0), max_steps=120)
    task.state = replace(task.state, lean_angle=np.array([0.5]), lean_rate=np.array([0.3]))
    found = []
    for _ in range(120):
        found.append(task.step(np.zeros((1, 3))))
    falls = np.array([item.fallen[0] for item in found])
    first = int(np.argmax(falls))
    assert falls[first:].all()
    assert 0 < first < 60
    # The first fallen step is rewarded by its own state, not by the last upright one.
    lean, rate, acceleration, error = found[first].observation[0, 2:]
    reward = -(lean**2 + 0.1 * rate**2 + 0.01 * acceleration**2 + 2.0 * error**2)
    assert abs(lean) > math.pi / 6
    for item in found[first:]:
        assert item.reward[0] == pytest.approx(reward, rel=1e-12)
        np.testing.assert_array_equal(item.observation, found[first].observation)
        assert not item.terminated[0]
    assert [bool(item.truncated[0]) for item in found] == [False] * 119 + [True]


def placed_task(goal: tuple[float, float], max_steps: int = 400) -> BicycleTask:
    """Return one bicycle at the origin, heading along +y."""
    scenario = Scenario(
        "placed",
        start=Region.point(0.0, 0.0),
        goal=Region.point(*goal),
        heading_spread=0.0,
        max_steps=max_steps,
    )
    return BicycleTask(scenario, rng=np.random.default_rng(0))


def test_row_26_goal_within_a_metre_of_the_rear_contact() -> None:
    travel = TEN_KM_H * K.time_step
    near = placed_task(goal=(0.0, travel + 0.999)).step(np.zeros((1, 3)))
    far = placed_task(goal=(0.0, travel + 1.001)).step(np.zeros((1, 3)))
    assert near.terminated[0]
    assert not far.terminated[0]
    # The front contact is long there.
    assert not placed_task(goal=(0.0, 1.11 + 1.0)).step(np.zeros((1, 3))).terminated[0]


def test_row_26_the_tightest_turn_at_ten_km_h_is_wider_than_the_goal() -> None:
    bare = TEN_KM_H**2 / (K.gravity * math.tan(math.radians(30.0)))
    assert bare == pytest.approx(1.36, abs=5e-3)
    # The model's own, at the centre of mass: the tyres' terms add a little.
    steer = np.linspace(0.0, 1.3, 100_001)
    lean = steady_lean(steer, np.full_like(steer, TEN_KM_H), K)
    tightest = steer[np.searchsorted(lean, math.radians(30.0)) - 1 :][:1]
    radius = 1.0 / dynamics.curvatures(tightest, K)[2].item()
    assert bare < radius < 1.05 * bare


def test_row_34_order_of_states_and_actions() -> None:
    assert OBSERVATION_FIELDS == (
        "steer_angle",
        "steer_rate",
        "lean_angle",
        "lean_rate",
        "lean_acceleration",
        "heading_error",
    )
    assert ACTION_FIELDS == ("torque", "displacement", "pedal_force")
    task = placed_task(goal=(7.0, 0.0))
    for value, name in enumerate(OBSERVATION_FIELDS[:5], start=1):
        setattr(task.state, name, np.array([0.1 * value]))
    assert task.observation()[0] == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5, math.pi / 2])


def test_row_35_the_authors_scaling() -> None:
    gym_env = pytest.importorskip("bicycle_sim.task.gym_env", exc_type=ImportError)
    assert (math.pi / 2, 1.0, math.pi / 6, 1.0, 1.0, 1.0) == gym_env.AUTHORS_SCALE
    env = gym_env.BicycleEnv(observation_scale=gym_env.AUTHORS_SCALE)
    env.reset(seed=3)
    env.task.state.lean_angle = np.array([math.pi / 12])
    env.task.state.steer_angle = np.array([math.pi / 4])
    scaled = env.step(np.zeros(2, np.float32))[0]
    raw = env.task.observation()[0]
    assert scaled == pytest.approx(raw / np.array(gym_env.AUTHORS_SCALE), rel=1e-6)


def test_row_39_position_fixed_and_heading_random() -> None:
    task = BicycleTask(named("fixed-start-fixed-goal"), count=4000, rng=np.random.default_rng(4))
    assert set(task.state.rear_x) == {50.0}
    assert set(task.state.rear_y) == {50.0}
    assert (set(task.goal_x), set(task.goal_y)) == ({60.0}, {65.0})
    counts, _ = np.histogram(task.state.heading, bins=8, range=(-math.pi, math.pi))
    assert counts.min() > 400


def test_row_40_reward_weights() -> None:
    goal, balance = RewardWeights(), RewardWeights.balance()
    assert (goal.lean_angle, goal.lean_rate, goal.lean_acceleration) == (1.0, 0.1, 0.01)
    assert goal.heading_error == 2.0
    assert (balance.lean_angle, balance.lean_rate, balance.lean_acceleration) == (0.01, 0.1, 1.0)
    terms = reward_terms(np.ones(1), np.ones(1), np.ones(1), np.ones(1), balance)
    assert sum(value.item() for value in terms.values()) == pytest.approx(-1.11)
