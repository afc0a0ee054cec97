"""The teachers are each bicycle's LQR: beside scipy's, and on the rides they must survive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from bicycle_controller.config.imitation import TeacherWeights, TurnConfig
from bicycle_controller.training.teachers import COMMANDS, Seen, Teachers
from bicycle_sim.plants.whipple import random_bicycles
from bicycle_sim.plants.whipple.parameters import take
from bicycle_sim.plants.whipple.plant import WhipplePlant

WEIGHTS = TeacherWeights(10.0, 1.0, 1.0, 0.1, 0.1)
SPEEDS = np.linspace(1.0, 6.0, 6)


def teachers_of(plant: WhipplePlant) -> Teachers:
    limits = np.asarray(plant.parameters.motor.limit)
    return Teachers(plant, WEIGHTS, TurnConfig(), SPEEDS, limits)


@pytest.mark.parametrize("delay", [0.0, 0.025, 0.04, 0.075])
def test_gains_are_those_of_scipy(delay: float) -> None:
    """The plant's own discrete model and scipy's solution give the same feedback."""
    p = random_bicycles.draw(3, np.random.default_rng(4))
    p = replace(p, delay=np.full(3, delay))
    found = teachers_of(WhipplePlant(p)).at(np.full(3, 3.0))
    for index in range(3):
        one = WhipplePlant(replace(take(p, [index]), name="one"))
        model = one.linearize(3.0, discrete=True)
        keep = [i for i, name in enumerate(model.states) if name != "heading_error"]
        a, b = (np.atleast_3d(value)[0] for value in (model.a, model.b))
        a, b = a[np.ix_(keep, keep)], b[keep]
        costs = np.zeros(len(keep))
        costs[:4] = 10.0, 1.0, 1.0, 0.1
        cost = solve_discrete_are(a, b, np.diag(costs), [[0.1]])
        gain = np.linalg.solve(0.1 + b.T @ cost @ b, b.T @ cost @ a)[0]
        np.testing.assert_allclose(found[index, : len(gain)], gain, rtol=2e-5, atol=1e-7)
        assert not found[index, len(gain) : 5 + COMMANDS].any()


def test_they_hold_a_turn_and_come_back_from_a_kick() -> None:
    plant = WhipplePlant(random_bicycles.draw(64, np.random.default_rng(5)))
    plain = replace(plant.parameters, road=replace(plant.parameters.road, grade_y=0.0, wind_y=0.0))
    plant = WhipplePlant(plain)
    teachers, zero = teachers_of(plant), np.zeros(64)
    state, commands, wanted = (
        plant.initial(zero, zero, zero, zero + 4.0),
        np.zeros((64, COMMANDS)),
        0.0,
    )
    for period in range(320):
        if period == 120:
            state = plant.pushed(state, np.full(64, 0.2))
        wanted += 0.2 * plant.time_step
        error = np.angle(np.exp(1j * (state.heading - wanted)))
        torque = teachers.act(Seen.of(state, error, commands))
        commands = np.column_stack([torque, commands[:, :-1]])
        state = plant.step(state, torque, zero, zero)
    upright = np.abs(state.lean_angle) < 0.5
    assert upright.mean() > 0.95
    rates = plant.yaw_rate(state)[upright]
    assert np.median(rates) == pytest.approx(0.2, abs=0.05)
    assert np.median(np.abs(error[upright])) < 0.8


def test_each_bicycle_may_have_other_weights() -> None:
    plant = WhipplePlant(random_bicycles.draw(4, np.random.default_rng(6)))
    limits = np.asarray(plant.parameters.motor.limit)
    strong = replace(WEIGHTS, torque=0.001)
    both = [Teachers(plant, w, TurnConfig(), SPEEDS, limits) for w in (WEIGHTS, strong)]
    tables = [item._table.copy() for item in both]
    which = np.zeros((len(SPEEDS), 4), dtype=int)
    which[2, 1] = 1
    both[0].choose(both, which)
    np.testing.assert_array_equal(both[0]._table[2, 1], tables[1][2, 1])
    np.testing.assert_array_equal(both[0]._table[2, 0], tables[0][2, 0])


def test_damping_swings_less_beyond_a_wanted_heading() -> None:
    """The wanted heading jumps by 1 rad; a damped heading loop goes less far beyond it."""
    plant = WhipplePlant(random_bicycles.draw(32, np.random.default_rng(7)))
    plain = replace(plant.parameters, road=replace(plant.parameters.road, grade_y=0.0, wind_y=0.0))
    plant, zero = WhipplePlant(plain), np.zeros(32)
    limits, beyond = np.asarray(plain.motor.limit), []
    for damping in (0.0, 0.2):
        turns = TurnConfig(damping=damping)
        teachers = Teachers(plant, WEIGHTS, turns, SPEEDS, limits)
        state, commands = plant.initial(zero, zero, zero, zero + 2.0), np.zeros((32, COMMANDS))
        furthest = zero
        for _ in range(320):
            error = state.heading - 1.0
            torque = teachers.act(Seen.of(state, error, commands))
            commands = np.column_stack([torque, commands[:, :-1]])
            state = plant.step(state, torque, zero, zero)
            furthest = np.maximum(furthest, error)
        assert np.median(np.abs(error)) < 0.3
        beyond.append(np.median(furthest))
    assert beyond[1] < beyond[0], beyond


def test_a_negative_damping_is_refused() -> None:
    with pytest.raises(ValueError, match="damping"):
        TurnConfig(damping=-0.1)
