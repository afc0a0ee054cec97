"""The contract that every plant keeps, and the paper's bicycle behind it to the bit."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from whipple_maker import various

from bicycle_sim.plants import base, registry
from bicycle_sim.plants.base import Loads, Plant
from bicycle_sim.plants.choi import dynamics, linear
from bicycle_sim.plants.choi.parameters import Constants, Physics
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.plants.whipple import catalogue
from bicycle_sim.plants.whipple.parameters import Motor
from bicycle_sim.plants.whipple.plant import WhipplePlant

MADE: dict[str, Plant[Any]] = {
    "choi": ChoiPlant(),
    "choi, corrected": ChoiPlant(Physics.named("corrected")),
    "whipple": registry.named("whipple"),
    "whipple, leaning rider": registry.named("whipple", "browser-leaning-rider"),
    "whipple, delay": WhipplePlant(
        replace(catalogue.load("benchmark").parameters, delay=0.06, motor=Motor(lag=0.03))
    ),
    "whipple, different bicycles": WhipplePlant(various(8, 1, rider=True)),
}


@pytest.fixture(params=MADE)
def plant(request: pytest.FixtureRequest) -> Plant[Any]:
    result: Plant[Any] = MADE[request.param]
    return result


def places() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    x, y = rng.normal(size=(2, 8)) * 20.0
    return x, y, rng.uniform(-3.0, 3.0, 8), rng.uniform(2.0, 5.0, 8)


def start(plant: Plant[Any]) -> Any:
    return plant.initial(*places())


def inputs(
    plant: Plant[Any], step: int, mask: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(step)
    moves = 0.02 * ("displacement" in plant.input_names)
    torque, displacement, pedal = rng.normal(size=(3, 8)) * [[1.0], [moves], [30.0]]
    keep = slice(None) if mask is None else mask
    return torque[keep], displacement[keep], pedal[keep]


def bits(state: Any) -> np.ndarray:
    return base.to_array(state).view(np.int64)


def test_it_starts_upright_with_straight_handlebars(plant: Plant[Any]) -> None:
    state = start(plant)
    assert isinstance(state, plant.state_type)
    for name in ("lean_angle", "lean_rate", "steer_angle", "steer_rate", "lean_acceleration"):
        assert not getattr(state, name).any()
    ahead = np.hypot(state.front_x - state.rear_x, state.front_y - state.rear_y)
    if plant.count is None:
        np.testing.assert_allclose(ahead, plant.geometry.wheelbase, rtol=1e-12)
    direction = np.arctan2(state.rear_x - state.front_x, state.front_y - state.rear_y)
    np.testing.assert_allclose(direction, state.heading, rtol=0, atol=1e-12)
    assert not plant.fallen(state, 0.5).any()


def test_all_fields_restart_it_to_the_bit(plant: Plant[Any]) -> None:
    state = start(plant)
    for step in range(10):
        state = plant.step(state, *inputs(plant, step))
    again = base.from_array(plant.state_type, base.to_array(state))
    reborn = registry.from_json(plant.to_json())
    for step in range(10, 20):
        state = plant.step(state, *inputs(plant, step))
        again = reborn.step(again, *inputs(plant, step))
    assert np.array_equal(bits(state), bits(again))


def test_json_keeps_every_bit_and_refuses_strangers(plant: Plant[Any]) -> None:
    text = plant.to_json()
    assert json.loads(text)["plant"] == plant.name
    assert registry.from_json(text).to_json() == text
    json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    with pytest.raises(ValueError, match="has no field 'whels'"):
        registry.from_json(json.dumps({**json.loads(text), "whels": 2}))


def test_a_trace_ends_where_the_step_does(plant: Plant[Any]) -> None:
    state = start(plant)
    for step in range(4):
        trace = plant.trace(state, *inputs(plant, step))
        state = plant.step(state, *inputs(plant, step))
        assert np.array_equal(bits(trace[-1]), bits(state))


def test_states_are_chosen_put_and_taken(plant: Plant[Any]) -> None:
    first = start(plant)
    second = plant.step(first, *inputs(plant, 0))
    mask = np.arange(8) % 3 == 0
    mixed = base.where(mask, first, second)
    assert np.array_equal(bits(mixed)[mask], bits(first)[mask])
    assert np.array_equal(bits(mixed)[~mask], bits(second)[~mask])
    part = base.take(first, mask)
    assert np.array_equal(bits(base.put(second, mask, part)), bits(mixed))
    # The bicycles of the mask ride on alone as they do among the others.
    alone = plant.take(mask).step(base.take(second, mask), *inputs(plant, 1, mask))
    together = plant.step(second, *inputs(plant, 1))
    width = base.to_array(alone).shape[1]
    assert np.array_equal(bits(alone), bits(together)[mask][:, :width])


def test_a_push_is_a_jump_of_the_lean_rate(plant: Plant[Any]) -> None:
    state = start(plant)
    pushed = plant.pushed(state, np.full(8, 0.25))
    assert (pushed.lean_rate == 0.25).all()
    assert (pushed.lean_angle == state.lean_angle).all()
    assert (state.lean_rate == 0.0).all()


def test_it_falls_without_a_rider_and_says_so(plant: Plant[Any]) -> None:
    state = plant.pushed(start(plant), 1.0)
    zero = np.zeros(8)
    for _ in range(80):
        state = plant.step(state, zero, zero, zero)
        if plant.fallen(state, 0.5).all():
            break
    if plant.count is None:
        assert plant.fallen(state, 0.5).any()
    assert np.array_equal(plant.fallen(state, 4.0), getattr(state, "stopped", zero) != 0.0)


def test_its_model_names_the_states_that_controllers_know(plant: Plant[Any]) -> None:
    if plant.count is not None:
        return
    for discrete in (False, True):
        model = plant.linearize(3.0, discrete)
        assert set(linear.STATE_FIELDS) <= set(model.states)
        assert model.inputs[0] == "torque"
        assert model.a.shape == (len(model.states),) * 2
        assert model.b.shape == (len(model.states), len(model.inputs))
        assert (model.time_step == plant.time_step) if discrete else (model.time_step is None)


def test_a_steady_turn_leans_into_itself(plant: Plant[Any]) -> None:
    lean = plant.steady_lean(np.linspace(-0.2, 0.2, 8), np.full(8, 3.0))
    assert (np.sign(lean) == np.sign(np.linspace(-0.2, 0.2, 8))).all()
    assert (np.diff(lean) > 0.0).all() if plant.count is None else True


def test_the_paper_s_bicycle_is_that_of_dynamics_to_the_bit() -> None:
    for mode in ("faithful", "corrected"):
        physics = Physics.named(mode)
        plant = ChoiPlant(physics)
        state = start(plant)
        other = dynamics.upright(*places(), physics.constants)
        for step in range(40):
            limits = (3.0, 4.0) if step % 3 else None
            state = plant.step(state, *inputs(plant, step), limits)
            other = dynamics.step(other, *inputs(plant, step), physics, limits)
        for name, values in vars(other).items():
            assert np.array_equal(getattr(state, name), values), name


def test_json_without_a_plant_is_the_paper_s_bicycle() -> None:
    physics = Physics(constants=Constants(wheelbase=1.2), stop_absorbs_steering=True)
    plant = registry.from_json(physics.to_json())
    assert isinstance(plant, ChoiPlant)
    assert plant.physics == physics


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("wipple",), "unknown plant 'wipple' .did you mean 'whipple'"),
        (("whipple", "browserrider"), "did you mean 'browser-rider'"),
        (("choi", "browser"), "has no bicycles to choose from"),
        (("choi", None, "right"), "unknown physics 'right'"),
    ],
)
def test_wrong_names_give_the_nearest(arguments: tuple[Any, ...], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        registry.named(*arguments)


@pytest.mark.parametrize("name", registry.PLANTS)
def test_a_kind_says_what_can_be_chosen_of_it(name: str) -> None:
    kind = registry.PLANTS[name]
    assert kind.about
    if name == "mujoco":
        pytest.importorskip("mujoco")
    if kind.takes_bicycle:
        assert registry.named(name, "browser-rider").label == f"{name} browser-rider"
    else:
        with pytest.raises(ValueError, match="has no bicycles to choose from"):
            registry.named(name, "browser-rider")
    plant = registry.named(name)
    if kind.takes_displacement_noise:
        assert plant.with_displacement_noise(0.01).displacement_noise == 0.01
    else:
        with pytest.raises(ValueError, match="takes no displacement noise"):
            plant.with_displacement_noise(0.01)


def test_the_plant_of_a_bicycle_needs_no_name() -> None:
    assert registry.named(bicycle="browser-rider") == registry.named("whipple", "browser-rider")
    assert registry.named() == registry.default()
    assert not registry.takes_bicycle(registry.default().name)
    with pytest.raises(ValueError, match="has no physics"):
        registry.named(bicycle="browser-rider", physics="corrected")


def test_the_gear_is_the_force_at_the_rim_per_pedal_force() -> None:
    plant = ChoiPlant()
    state, zero = start(plant), np.zeros(8)
    moved = plant.step(state, zero, zero, np.full(8, 50.0))
    force = plant.physics.constants.driven_mass * (moved.speed - state.speed) / plant.time_step
    np.testing.assert_allclose(force, 50.0 * plant.pedal_gear, rtol=1e-9)


def test_the_paper_s_bicycle_takes_no_loads() -> None:
    plant, zero = ChoiPlant(), np.zeros(8)
    state = start(plant)
    with pytest.raises(ValueError, match="takes no loads"):
        plant.step(state, zero, zero, zero, None, Loads(lateral_force=1.0))


def test_a_whipple_bicycle_takes_another_time_step() -> None:
    """Five steps of 5 ms are one of 25 ms while the torque is the same, but for rounding."""
    plant = registry.named("whipple", "browser-rider")
    assert plant.with_time_step(plant.time_step, plant.substeps) == plant
    quick = plant.with_time_step(0.2 * plant.time_step, 1)
    given, zero = np.full(8, 0.5), np.zeros(8)
    state = start(quick)
    for _ in range(5):
        state = quick.step(state, given, zero, zero)
    five = plant.with_time_step(plant.time_step, 5)
    once = five.step(start(five), given, zero, zero)
    np.testing.assert_allclose(state.lean_rate, once.lean_rate, rtol=1e-9)
    np.testing.assert_allclose(state.steer_angle, once.steer_angle, rtol=1e-9)


def test_a_whipple_bicycle_takes_delay_motor_and_friction() -> None:
    plant = registry.named("whipple", "browser-rider").with_actuation(0.05, 7.0, 0.03, 0.1, 0.2)
    assert isinstance(plant, WhipplePlant)
    motor, steering = plant.parameters.motor, plant.parameters.steering
    assert (plant.parameters.delay, motor.limit, motor.lag, motor.step) == (0.05, 7.0, 0.03, 0.1)
    assert (steering.friction, steering.stiction) == (0.2, 0.2)
    assert plant.steer_friction == 0.2
    assert ChoiPlant().steer_friction == 0.0


def test_a_plant_refuses_what_it_cannot_be() -> None:
    with pytest.raises(ValueError, match=r"choi steps by 0\.0\d+ s only: choose plant:=whipple"):
        ChoiPlant().with_time_step(0.005, 1)
    with pytest.raises(ValueError, match="only a Whipple bicycle has a motor and friction"):
        ChoiPlant().with_actuation(0.0, 7.0, 0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="stepped on the processor only: use device=cpu"):
        registry.named("whipple").on_device("cuda")
