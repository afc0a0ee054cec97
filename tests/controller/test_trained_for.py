"""Differences of a ride from those that a controller was made for."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from policies import make_policy

from bicycle_controller.control.controller import Controller
from bicycle_controller.control.lqr import LqrController
from bicycle_controller.policy.policy import Policy, load_policy
from bicycle_controller.policy.trained_for import differences, held_back, unlike_training, warning
from bicycle_sim.plants import registry
from bicycle_sim.plants.choi.parameters import Constants, Physics
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import SCENARIOS

FAITHFUL = ChoiPlant()
LONG = ChoiPlant(Physics(constants=replace(Constants(), wheelbase=1.2, bicycle_mass=14.0)))


def test_each_constant_and_switch_that_differs_is_named() -> None:
    assert differences(FAITHFUL, FAITHFUL) == []
    assert differences(FAITHFUL, LONG) == ["wheelbase 1.2, not 1.11", "bicycle_mass 14, not 15"]
    assert differences(ChoiPlant.named("corrected"), FAITHFUL) == [
        "chord_follows_steering false, not true",
        "gyroscopic_correction false, not true",
        "stop_absorbs_steering false, not true",
    ]
    noisy = FAITHFUL.with_displacement_noise(0.02)
    assert differences(FAITHFUL, noisy) == [], "a disturbance"


def test_another_plant_or_bicycle_is_named() -> None:
    benchmark, browser = (registry.named("whipple", name) for name in ("benchmark", "browser"))
    assert differences(FAITHFUL, benchmark) == ["plant whipple, not choi"]
    (difference,) = differences(benchmark, browser)
    assert difference.startswith("name ")
    assert ", not " in difference


@pytest.mark.parametrize("controller", [make_policy(), LqrController()])
def test_a_controller_is_compared_with_what_it_was_made_for(controller: Controller) -> None:
    assert unlike_training(controller, FAITHFUL) == []
    assert unlike_training(controller, LONG) == [
        "wheelbase 1.2, not 1.11",
        "bicycle_mass 14, not 15",
    ]


def test_the_other_physics_of_its_training_is_no_other_bicycle() -> None:
    corrected, policy = ChoiPlant.named("corrected"), make_policy()
    assert unlike_training(policy, corrected)
    for known, strange in ((corrected.to_json(), False), (LONG.to_json(), True), ("{}", True)):
        trained = {"physics_too": json.loads(known)}
        both = Policy(replace(policy.info, trained=trained), policy.tensors)
        assert bool(unlike_training(both, corrected)) == strange
        assert unlike_training(both, FAITHFUL) == []


def test_the_speed_counts_as_far_as_the_policy_was_trained_for_it() -> None:
    fixed, learned = load_policy("fixed-speed"), load_policy("learned-speed")
    scenario = SCENARIOS["random-start-random-goal"]
    slow = replace(scenario, start_speed=1.5)
    assert unlike_training(fixed, FAITHFUL, scenario) == []
    assert unlike_training(fixed, FAITHFUL, slow) == ["start speed 1.5 m/s, not 2.78"]
    assert unlike_training(learned, FAITHFUL, slow) == []
    fast = replace(scenario, start_speed=9.0)
    assert unlike_training(learned, FAITHFUL, fast) == ["start speed 9 m/s, not 1 to 5"]


def test_less_torque_than_it_was_trained_with_is_named() -> None:
    fixed, any_bicycle = load_policy("fixed-speed"), load_policy("any-bicycle")
    scenario = fixed.info.scenario
    weak = replace(scenario, torque_limit=0.5)
    assert held_back(fixed, FAITHFUL, scenario) == []
    assert held_back(fixed, FAITHFUL, weak) == ["torque limited to 0.5 N m, not 2"]
    assert held_back(any_bicycle, registry.named("whipple", "browser"), weak) == []
    assert held_back(LqrController(), FAITHFUL, weak) == []


def test_what_says_nothing_of_itself_differs_in_nothing() -> None:
    class Free:
        policy_id = "free"

        act = Policy.act

    assert unlike_training(Free(), LONG, SCENARIOS["fixed-start-fixed-goal"]) == []


def test_the_warning_is_one_line_with_the_remedy() -> None:
    assert warning("mine", []) == ""
    text = warning("mine", ["wheelbase 1.2, not 1.11"])
    assert text.startswith("policy mine was made for another ride (wheelbase 1.2, not 1.11)")
    assert "train one for this" in text
    assert "\n" not in text
