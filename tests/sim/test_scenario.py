"""The paper's experiments as data, and what their configuration refuses."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bicycle_common.geometry import heading_between, wrap_angle
from bicycle_sim.plants.choi.parameters import Constants, Physics
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import SCENARIOS, Region, Scenario, named
from bicycle_sim.task.task import BicycleTask

TEN_KM_H = 10.0 / 3.6


@pytest.mark.parametrize(
    ("name", "speed", "limits", "steps"),
    [
        ("fixed-start-fixed-goal", TEN_KM_H, (2.0, 0.2, 0.0), 400),
        ("random-start-fixed-goal", TEN_KM_H, (2.0, 0.2, 0.0), 4000),
        ("random-start-random-goal", TEN_KM_H, (2.0, 0.2, 0.0), 4000),
        ("random-small-displacement", TEN_KM_H, (2.0, 0.02, 0.0), 4000),
        ("learning-to-turn", 2.5, (2.0, 0.02, 100.0), 500),
        ("learning-to-turn-fixed-speed", 2.5, (2.0, 0.02, 0.0), 500),
        ("learned-speed", 2.0, (2.0, 0.02, 100.0), 4000),
    ],
)
def test_the_papers_experiments(
    name: str, speed: float, limits: tuple[float, ...], steps: int
) -> None:
    scenario = named(name)
    assert scenario.start_speed == speed
    assert tuple(scenario.action_limits) == limits
    assert scenario.max_steps == steps
    assert scenario.goal_radius == 1.0
    assert scenario.fall_angle == math.pi / 6


def test_random_starts_and_goals_fill_the_field() -> None:
    task = BicycleTask(named("random-start-random-goal"), None, 4000, np.random.default_rng(1))
    state = task.state
    for values in (state.rear_x, state.rear_y, task.goal_x, task.goal_y):
        counts, _ = np.histogram(values, bins=5, range=(0.0, 200.0))
        assert counts.sum() == 4000
        assert counts.min() > 700
    assert abs(np.corrcoef(state.rear_x, task.goal_x)[0, 1]) < 0.05


def test_learning_to_turn_starts_away_from_the_goal() -> None:
    task = BicycleTask(named("learning-to-turn"), count=1000, rng=np.random.default_rng(2))
    away = heading_between(60.0, 65.0, 50.0, 50.0)
    off = np.abs(wrap_angle(task.state.heading - away))
    assert off.max() <= math.pi / 6 + 1e-9
    assert off.max() > 0.95 * math.pi / 6
    assert (np.abs(task.observation()[:, 5]) >= 5 * math.pi / 6 - 1e-9).all()


@pytest.mark.parametrize("name", list(SCENARIOS))
def test_json_keeps_every_bit(name: str) -> None:
    scenario = replace(SCENARIOS[name], start_speed=2.0 + 1.0 / 3.0)
    assert Scenario.from_json(scenario.to_json()) == scenario


@pytest.mark.parametrize("mode", ["faithful", "corrected"])
def test_physics_json_keeps_every_bit(mode: str) -> None:
    physics = replace(Physics.named(mode), constants=Constants(time_step=0.1 / 3.0))
    assert Physics.from_json(physics.to_json()) == physics


def test_a_typo_names_the_nearest() -> None:
    with pytest.raises(ValueError, match=r"did you mean 'learned-speed'\?.*known: fixed-start"):
        named("learnt-speed")
    with pytest.raises(ValueError, match=r"no field 'torque_limt'.*'torque_limit'"):
        Scenario.from_dict({"torque_limt": 1.0})
    with pytest.raises(ValueError, match=r"Constants has no field 'gravty'.*'gravity'"):
        Physics.from_json('{"constants": {"gravty": 1}}')
    with pytest.raises(ValueError, match="choose faithful or corrected"):
        ChoiPlant.named("true")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"torque_limit": -1.0}, "torque_limit must be zero or more"),
        ({"torque_limit": math.nan}, "torque_limit must be zero or more"),
        ({"displacement_limit": math.inf}, "displacement_limit must be zero or more"),
        ({"start_speed": 0.0}, "start_speed must be above zero"),
        ({"goal_radius": -1.0}, "goal_radius must be above zero"),
        ({"max_steps": 0}, "max_steps must be at least 1"),
        ({"speed_limits": (3.0, 5.0)}, "must lie within speed_limits"),
        ({"speed_limits": (1.0, 2.0, 3.0)}, "expected two numbers"),
    ],
)
def test_impossible_scenarios_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        replace(named("random-start-random-goal"), **changes)


def test_impossible_regions_and_constants_are_refused() -> None:
    with pytest.raises(ValueError, match="beyond its high corner"):
        Region((1.0, 0.0), (0.0, 1.0))
    with pytest.raises(ValueError, match="time_step must be a finite number above zero"):
        Constants(time_step=0.0)
    with pytest.raises(ValueError, match="steer_stop must be below pi/2"):
        Constants(steer_stop=1.6)
    with pytest.raises(ValueError, match="displacement_noise must be zero or more"):
        Physics(displacement_noise=-0.1)
