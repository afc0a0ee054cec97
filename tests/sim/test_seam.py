"""Any plant rides: task, simulator, LQR and safety layer know none by name.

The point mass of `point_mass.py` is no part of the product, the Whipple bicycle is.
"""

from __future__ import annotations

import copy
import json
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from point_mass import PointMass
from whipple_maker import various

from bicycle_common.observation import ACTION_FIELDS
from bicycle_common.types import BicycleState, Command, InitialPose
from bicycle_controller.control.lqr import TUNED, LqrController, tuning_id
from bicycle_controller.control.safety import Safety
from bicycle_controller.evaluation.evaluate import evaluate
from bicycle_controller.evaluation.rollouts import Disturbance
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant
from bicycle_sim.plants.choi.parameters import Physics
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.plants.whipple import catalogue
from bicycle_sim.plants.whipple.parameters import Motor
from bicycle_sim.plants.whipple.plant import WhipplePlant
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.gym_env import BicycleEnv
from bicycle_sim.task.scenario import Region, named
from bicycle_sim.task.task import BicycleTask

SCENARIO = replace(named("learned-speed"), start_speed=4.0)
NEAR = replace(named("random-start-random-goal"), start_speed=4.0, max_steps=1500)
PLANTS: dict[str, Plant[Any]] = {
    "point mass": PointMass(),
    "choi": ChoiPlant(),
    "whipple": registry.named("whipple", "browser-rider"),
    "whipple, leaning rider": registry.named("whipple", "browser-leaning-rider"),
    "whipple, delay and lag": WhipplePlant(
        replace(catalogue.load("benchmark").parameters, delay=0.06, motor=Motor(lag=0.03))
    ),
}


@pytest.fixture(params=PLANTS)
def plant(request: pytest.FixtureRequest) -> Plant[Any]:
    result: Plant[Any] = PLANTS[request.param]
    return result


def commands(plant: Plant[Any], count: int) -> list[Command | None]:
    rng = np.random.default_rng(4)
    limits = SCENARIO.suited(plant.input_names).action_limits * [0.5, 1.0, 1.0]
    drawn = (rng.uniform(-limits, limits).tolist() for _ in range(count))
    result: list[Command | None] = [Command(1, step, *given) for step, given in enumerate(drawn)]
    result[3] = None
    return result


def test_what_a_plant_has_no_use_for_is_limited_to_zero(plant: Plant[Any]) -> None:
    task, simulator = BicycleTask(SCENARIO, plant), Simulator(SCENARIO, plant)
    for scenario in (task.scenario, simulator.scenario):
        driven = np.array(ACTION_FIELDS)[scenario.action_limits > 0]
        assert set(driven) == set(plant.input_names)
    task.step(np.array([[9.0, 9.0, 9.0]]))


def test_one_bicycle_rides_as_many_do(plant: Plant[Any]) -> None:
    """The simulator and the task move the same bicycle to the bit."""
    simulator = Simulator(SCENARIO, plant, seed=3)
    simulator.reset(InitialPose(1.0, 2.0, 0.3, SCENARIO.start_speed))
    task = BicycleTask(SCENARIO, plant, 3, np.random.default_rng(1), native=False)
    one = np.ones(3)
    task.place(one > 0, one, 2.0 * one, 0.3 * one, 50.0 * one, 50.0 * one)
    for command in commands(plant, 40):
        state = simulator.step(command)
        action = command.action if command else (0.0, 0.0, 0.0)
        task.step(np.tile(action, (3, 1)))
        for name in ("lean_angle", "lean_acceleration", "steer_rate", "heading", "front_x"):
            assert getattr(task.state, name)[1] == getattr(state, name), name
        assert bool(task.fallen[1]) == state.fallen


@pytest.mark.parametrize("begun", [0, 2, 9])
def test_restored_from_any_state_it_repeats_every_bit(plant: Plant[Any], begun: int) -> None:
    """The state comes from a message's numbers, plant and scenario from JSON."""
    simulator = Simulator(SCENARIO, plant, seed=5)
    states: list[BicycleState] = [simulator.reset(InitialPose(0.0, 0.0, 0.5, 4.0))]
    given = commands(plant, 20)
    states += [simulator.step(command, 0.1 * (step == 12)) for step, command in enumerate(given)]
    data = json.loads(plant.to_json())
    known = PointMass.from_dict(data) if isinstance(plant, PointMass) else registry.from_dict(data)
    again = Simulator.restore(states[begun], SCENARIO, known, simulator.seed)
    for step in range(begun, 20):
        assert again.step(given[step], 0.1 * (step == 12)) == states[step + 1]
    assert bool(states[0].plant_state) == (plant.name != "choi")


def test_a_state_of_another_plant_is_refused(plant: Plant[Any]) -> None:
    state = replace(Simulator(SCENARIO, plant).snapshot, plant_state=(1.0, 2.0))
    if plant.name == "choi":
        return
    with pytest.raises(ValueError, match="columns"):
        Simulator.restore(state, SCENARIO, plant, 0)


def test_where_it_lies_says_the_plant() -> None:
    """The point mass falls at nine tenths of the scenario's angle."""
    simulator, task = Simulator(SCENARIO, PointMass()), BicycleTask(SCENARIO, PointMass())
    simulator.reset(InitialPose(0.0, 0.0, 0.0, 1.0))
    state = simulator.step(None, 2.0)
    task.state = task.plant.pushed(task.state, 2.0)
    while not state.fallen:
        state = simulator.step(None)
    while not task.step(np.zeros((1, 3))).fallen[0]:
        pass
    limit = SCENARIO.fall_angle
    assert 0.9 * limit < abs(state.lean_angle) < limit
    assert 0.9 * limit < abs(task.state.lean_angle[0]) < limit
    lying = task.state
    task.step(np.ones((1, 3)))
    assert task.state.last_torque == lying.last_torque, "a fallen bicycle's state is frozen"


def test_an_lqr_of_its_own_model_rides_each(plant: Plant[Any]) -> None:
    """It reaches goals all around by the observation alone, without a fall."""
    near = Region((-20.0, -20.0), (20.0, 20.0))
    scenario = replace(NEAR, start=near, goal=near)
    controller = LqrController(None, plant)
    found = evaluate(controller, scenario, plant, 8, seed=1)
    assert found.summary()["reach_rate"] == 1.0
    assert tuning_id(controller.config, plant) == controller.policy_id
    assert len({tuning_id(controller.config, other) for other in PLANTS.values()}) == len(PLANTS)


def test_the_lean_that_is_asked_for_at_every_step_is_that_of_the_plant(plant: Plant[Any]) -> None:
    law, rng = plant.steady_lean_law(0.7), np.random.default_rng(6)
    steer, speed = rng.uniform(-0.75, 0.75, 200), rng.uniform(1.0, 6.0, 200)
    inside = np.clip(steer, -0.7, 0.7) if plant.name == "whipple" else steer
    exact = plant.steady_lean(inside, speed)
    np.testing.assert_allclose(law(steer, speed), exact, rtol=0, atol=1e-3)
    beyond = law(np.array([0.5, -0.6]), np.array([1e3, 0.0]))
    assert np.isfinite(beyond).all()


def test_disturbances_reach_each(plant: Plant[Any]) -> None:
    """A tilt and a kick make another ride of it, and steps still follow from the seed."""
    scenario = replace(NEAR, max_steps=20)
    trial = Disturbance(roll_kick=0.2, kick_time=0.2, initial_tilt=0.05)
    controller = LqrController(None, plant)
    calm, shaken, again = (
        evaluate(controller, scenario, plant, 8, 2, trial) for trial in (None, trial, trial)
    )
    assert (shaken.rides.peak_lean != calm.rides.peak_lean).all()
    assert (shaken.rides.peak_lean == again.rides.peak_lean).all()


def test_the_safety_layer_takes_each(plant: Plant[Any]) -> None:
    """A lean at rest is its own extrapolated lean, whatever is unstable."""
    layer = Safety(plant=plant)
    seen = np.array([[0.0, 0.0, 0.1, 0.0, 0.0, 0.0]])
    assert layer.extrapolated_lean(seen, np.array([2.0]))[0] == pytest.approx(0.1)


def test_many_different_bicycles_start_again_one_by_one() -> None:
    task = BicycleTask(
        SCENARIO, WhipplePlant(various(8, 1, rider=True)), 8, np.random.default_rng(2)
    )
    rng = np.random.default_rng(3)
    for step in range(60):
        task.step(rng.normal(size=(8, 3)) * [3.0, 0.01, 10.0])
        task.reset(task.fallen | (rng.random(8) < 0.1 * (step == 30)))
    kept = np.array([True, False] * 4)
    before = task.state.pitch[kept]
    task.keep(kept)
    assert task.count == task.plant.count == 4
    assert (task.state.pitch == before).all()
    task.step(np.zeros((4, 3)))


def test_plants_are_values(plant: Plant[Any]) -> None:
    """Equal by their parameters, hashable, copied and sent to other processes."""
    assert pickle.loads(pickle.dumps(plant)) == plant == copy.deepcopy(plant)
    assert hash(pickle.loads(pickle.dumps(plant))) == hash(plant)
    assert sum(plant == other for other in PLANTS.values()) == 1
    assert plant.label in repr(plant)


def test_displacement_noise_is_the_papers_bicycles() -> None:
    assert ChoiPlant().with_displacement_noise(0.02).displacement_noise == 0.02
    whipple = PLANTS["whipple"]
    assert whipple.with_displacement_noise(0.0) is whipple
    with pytest.raises(ValueError, match="takes no displacement noise"):
        whipple.with_displacement_noise(0.02)


def test_an_lqr_cannot_move_what_is_not_there() -> None:
    with pytest.raises(ValueError, match="no displacement moves the bicycle whipple"):
        LqrController(TUNED["lqr-displacement"], PLANTS["whipple"])


def test_gymnasium_rides_a_named_bicycle() -> None:
    env = BicycleEnv("learned-speed", plant="whipple", bicycle="browser-rider")
    assert env.action_names == ("torque", "pedal_force")
    first, _ = env.reset(seed=1)
    seen, *_ = env.step(np.array([0.5, 0.0], np.float32))
    assert (first != seen).any()
    with pytest.raises(ValueError, match="has no physics"):
        BicycleEnv(plant="whipple", physics="corrected")


def test_ids_of_the_papers_lqr_are_as_they_were() -> None:
    """Bags and pages know them from before there were other plants."""
    assert LqrController().policy_id == "lqr-bffdd42e"
    noisy = ChoiPlant(Physics(displacement_noise=0.02))
    assert LqrController(None, noisy).policy_id != LqrController().policy_id
