"""The dynamics against an independent program, worked numbers, symmetries and limits."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import reference_bicycle as reference
from busy_machine import UNHURRIED
from hypothesis import given, settings
from hypothesis import strategies as st
from reference_bicycle import Bicycle
from state_maker import SYMBOLS, riding, rows, state_of

from bicycle_sim.plants.choi import dynamics
from bicycle_sim.plants.choi.dynamics import State
from bicycle_sim.plants.choi.linear import (
    INPUT_FIELDS,
    STATE_FIELDS,
    discrete,
    eigenvalues,
    steady_lean,
)
from bicycle_sim.plants.choi.parameters import Constants, Physics

FAITHFUL, CORRECTED = Physics(), Physics.named("corrected")
K = Constants()
Actions = list[tuple[float, float, float]]
LISTED_SPEEDS = (1.0, 2.0, 10.0 / 3.6, 4.0, 5.0)


def between(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high).map(lambda value: round(value, 9))


bicycles = st.builds(
    Bicycle.heading,
    between(-3.14, 3.14),
    omega=between(-0.5, 0.5),
    omega_dot=between(-2.0, 2.0),
    theta=between(-1.39, 1.39),
    theta_dot=between(-10.0, 10.0),
    v=between(0.5, 5.0),
)
actions = st.tuples(between(-2.0, 2.0), between(-0.2, 0.2), between(-100.0, 100.0))
rides = st.lists(actions, min_size=1, max_size=20)
ordinary = settings(UNHURRIED, max_examples=60)


def ride(state: State, actions: Actions, physics: Physics) -> State:
    for torque, displacement, force in actions:
        one = np.ones_like(state.speed)
        state = dynamics.step(state, torque * one, displacement * one, force * one, physics)
    return state


@ordinary
@given(bicycles, rides)
def test_rides_as_the_reference_program(bicycle: Bicycle, actions: Actions) -> None:
    state, other = state_of(bicycle), bicycle
    for torque, displacement, force in actions:
        state = ride(state, [(torque, displacement, force)], FAITHFUL)
        other = reference.step(other, torque, displacement, force)
        np.testing.assert_allclose(rows(state), rows(state_of(other)), rtol=1e-9, atol=1e-8)
        state = state_of(other)  # The next step starts level, as errors grow 110-fold a second.


def test_one_step_worked_by_hand() -> None:
    start = riding(
        heading=0.4, speed=2.5, lean_angle=0.05, lean_rate=0.2, steer_angle=0.1, steer_rate=-0.3
    )
    end = ride(start, [(1.5, 0.02, 50.0)], FAITHFUL)
    found = {name: getattr(end, name).item() for name in SYMBOLS}
    # v = 2.5 + 0.025 * 0.2 * 50 / 76.7; sigma_dot = v / 0.34 = 7.362527...
    # 1/r_f = sin 0.1 / 1.11 = 0.0899400, 1/r_b = tan 0.1 / 1.11 = 0.0903916,
    # 1/r_CM = 1 / sqrt(0.45^2 + 1.11^2 / tan^2 0.1) = 0.0903169.
    # phi = 0.05 + atan(0.02 / 0.94) = 0.0712734; gyroscopic -0.434065, centrifugal 40.552874.
    # omega_dd = (692.31 sin phi - cos phi (40.552874 - 0.434065)) / 149.69 = 0.0620252.
    # theta_dd = (1.5 - 0.29478 * 7.3625278 * 0.2) / 0.09826 = 10.8481051.
    # Front travels at psi + theta' + asin(v dt / 2 r_f) = 0.5020944, rear at 0.4028284; the
    # contacts end 1.1096917 m apart, which is near enough. Worked with 30 digits.
    assert found == pytest.approx(
        {
            "lean_angle": 0.055038765780854,
            "lean_rate": 0.20155063123418,
            "lean_acceleration": 0.062025249367182,
            "steer_angle": 0.099280065711834,
            "steer_rate": -0.028797371526623,
            "heading": 0.40558817247169,
            "front_x": -0.46237247995406,
            "front_y": 1.0772351666184,
            "rear_x": -0.024533315182498,
            "rear_y": 0.057572205750366,
            "speed": 2.503259452412,
        },
        rel=1e-12,
    )


@ordinary
@given(bicycles, rides, st.sampled_from((FAITHFUL, CORRECTED)))
def test_wheelbase_is_kept(bicycle: Bicycle, actions: Actions, physics: Physics) -> None:
    end = ride(state_of(bicycle), actions, physics)
    apart = np.hypot(end.front_x - end.rear_x, end.front_y - end.rear_y)
    assert abs(apart.item() - K.wheelbase) <= K.wheelbase_tolerance + 1e-12


def turned(state: State, angle: float) -> State:
    """Return the same bicycle after turning the world counter-clockwise about the origin."""
    sine, cosine = math.sin(angle), math.cos(angle)
    front = (
        cosine * state.front_x - sine * state.front_y,
        sine * state.front_x + cosine * state.front_y,
    )
    rear = (
        cosine * state.rear_x - sine * state.rear_y,
        sine * state.rear_x + cosine * state.rear_y,
    )
    heading = np.arctan2(rear[0] - front[0], front[1] - rear[1])
    return replace(
        state, heading=heading, front_x=front[0], front_y=front[1], rear_x=rear[0], rear_y=rear[1]
    )


def mirrored(state: State) -> State:
    """Return the same bicycle in a mirror that stands along the y axis."""
    even = ("speed", "front_y", "rear_y")
    return replace(state, **{name: -getattr(state, name) for name in SYMBOLS if name not in even})


def same(one: State, other: State, tolerance: float = 1e-8) -> bool:
    return bool(np.allclose(contacts(one), contacts(other), rtol=0, atol=tolerance))


def contacts(state: State) -> np.ndarray:
    return np.stack([state.front_x, state.front_y, state.rear_x, state.rear_y])


@ordinary
@given(bicycles, rides, st.floats(-3.0, 3.0))
def test_corrected_rides_alike_in_every_direction(
    bicycle: Bicycle, actions: Actions, angle: float
) -> None:
    start = state_of(bicycle)
    end = ride(turned(start, angle), actions, CORRECTED)
    assert same(end, turned(ride(start, actions, CORRECTED), angle))


@ordinary
@given(bicycles, rides)
def test_corrected_rides_alike_to_both_sides(bicycle: Bicycle, actions: Actions) -> None:
    start, opposite = state_of(bicycle), [(-t, -d, f) for t, d, f in actions]
    end = ride(mirrored(start), opposite, CORRECTED)
    assert same(end, mirrored(ride(start, actions, CORRECTED)))


def test_faithful_depends_on_the_heading() -> None:
    # Row 5: the side of the half chord follows the heading instead of the turn.
    start, actions = riding(heading=0.3, steer_angle=0.5), [(0.0, 0.0, 0.0)] * 10
    away = turned(start, -1.8)
    assert not same(
        ride(away, actions, FAITHFUL), turned(ride(start, actions, FAITHFUL), -1.8), 1e-3
    )
    assert same(ride(away, actions, CORRECTED), turned(ride(start, actions, CORRECTED), -1.8))


@ordinary
@given(bicycles)
def test_gyroscopic_pair_does_no_work_when_corrected(bicycle: Bicycle) -> None:
    spin = K.tyre_spin_inertia * bicycle.v / K.tyre_radius * bicycle.omega_dot * bicycle.theta_dot
    # On an upright bicycle nothing is left; on a leaning one the projection onto the vertical.
    upright = replace(bicycle, omega=0.0)
    assert gyroscopic_power(upright, CORRECTED) == pytest.approx(0.0, abs=1e-9)
    left = (1.0 - math.cos(bicycle.omega)) * spin
    assert gyroscopic_power(bicycle, CORRECTED) == pytest.approx(left, rel=1e-6, abs=1e-9)
    # As printed the pair drains or feeds: both terms have one sign, and I_dv is 3/2 I_dc.
    assert gyroscopic_power(upright, FAITHFUL) == pytest.approx(-2.5 * spin, rel=1e-6, abs=1e-9)


def gyroscopic_power(bicycle: Bicycle, physics: Physics) -> float:
    """W that the rates of lean and steering exchange through the spinning tyres."""
    state, zero = state_of(bicycle), np.zeros(1)
    turn = dynamics.curvatures(state.steer_angle, K)
    torques = []
    for rate in (state.steer_rate, zero):
        other = replace(state, steer_rate=rate)
        torques.append(K.lean_inertia * dynamics.lean_equation(other, zero, state.speed, turn, K))
    for rate in (state.lean_rate, zero):
        other = replace(state, lean_rate=rate)
        found = dynamics.steer_equation(other, zero, state.speed, physics)
        torques.append(K.tyre_steer_inertia * found)
    lean, steer = torques[0] - torques[1], torques[2] - torques[3]
    return (lean * state.lean_rate + steer * state.steer_rate).item()


@pytest.mark.parametrize(
    ("speed", "low", "high"),
    # The table's 1.1 to 1.9 s hold up to 3.5 m/s; the printed signs tip faster ones sooner.
    [(speed, 1.1, 1.9) for speed in (1.0, 1.5, 2.0, 10.0 / 3.6, 3.5)]
    + [(4.0, 1.0, 1.1), (5.0, 0.85, 1.0)],
)
def test_falls_from_one_degree_without_action(speed: float, low: float, high: float) -> None:
    state = riding(speed=speed, lean_angle=math.radians(1.0))
    steps = 0
    while not dynamics.fallen(state.lean_angle).item():
        state = ride(state, [(0.0, 0.0, 0.0)], FAITHFUL)
        steps += 1
    assert low <= steps * K.time_step <= high + 1e-9


def test_straight_handlebar_is_no_special_place() -> None:
    angles = np.array([-1e-6, -1e-12, -0.0, 0.0, 1e-12, 1e-6])
    for curvature in dynamics.curvatures(angles, K):
        np.testing.assert_allclose(curvature, np.abs(angles) / K.wheelbase, rtol=1e-9, atol=1e-30)
    state = riding(heading=0.7, count=6, steer_angle=angles, lean_angle=0.1)
    end = rows(ride(state, [(0.0, 0.0, 0.0)], FAITHFUL))
    assert np.isfinite(end).all()
    np.testing.assert_allclose(end, end[:, 2:3] * np.ones(6), rtol=0, atol=1e-4)


@ordinary
@given(st.lists(bicycles, min_size=2, max_size=9), rides)
def test_many_ride_as_each_alone(several: list[Bicycle], actions: Actions) -> None:
    together = rows(ride(state_of(*several), actions, FAITHFUL))
    alone = [rows(ride(state_of(bicycle), actions, FAITHFUL)) for bicycle in several]
    np.testing.assert_array_equal(together, np.concatenate(alone, axis=1))


@settings(max_examples=20, deadline=None)
@given(st.lists(bicycles, min_size=1, max_size=4), rides, st.sampled_from((FAITHFUL, CORRECTED)))
def test_tensors_ride_as_arrays(
    several: list[Bicycle], actions: Actions, physics: Physics
) -> None:
    torch = pytest.importorskip("torch")
    arrays, tensors = state_of(*several), state_of(*several, xp=torch)
    limits = (1.0, 5.0)
    for action in actions:
        torque, displacement, force = (value * np.ones(len(several)) for value in action)
        arrays = dynamics.step(arrays, torque, displacement, force, physics, limits)
        torque, displacement, force = map(torch.as_tensor, (torque, displacement, force))
        tensors = dynamics.step(tensors, torque, displacement, force, physics, limits, torch)
        np.testing.assert_allclose(rows(tensors), rows(arrays), rtol=1e-9, atol=1e-9)
        arrays = State(**{name: getattr(tensors, name).numpy() for name in SYMBOLS})


def test_step_leaves_its_argument_alone() -> None:
    state = riding(steer_angle=0.2, lean_angle=0.1)
    before = rows(state).copy()
    ride(state, [(1.0, 0.1, 50.0)], CORRECTED)
    np.testing.assert_array_equal(rows(state), before)


@pytest.mark.parametrize("physics", [FAITHFUL, CORRECTED], ids=["faithful", "corrected"])
@pytest.mark.parametrize("speed", LISTED_SPEEDS)
def test_discrete_model_is_the_steps_jacobian(speed: float, physics: Physics) -> None:
    a, b = discrete(speed, physics)
    small = 1e-6

    def after(state: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        names = dict(zip(STATE_FIELDS[:4], state, strict=False))
        # Away from psi = 0, where the printed sign(psi) of row 5 jumps.
        end = dynamics.step(
            riding(heading=0.5 + state[4], speed=speed, **names),
            np.array(inputs[:1]),
            np.array(inputs[1:]),
            np.zeros(1),
            physics,
        )
        found = [getattr(end, name).item() for name in STATE_FIELDS[:4]]
        return np.array([*found, end.heading.item() - 0.5])

    for column in range(5):
        push = small * np.eye(5)[column]
        slope = (after(push, np.zeros(2)) - after(-push, np.zeros(2))) / (2 * small)
        np.testing.assert_allclose(slope, a[:, column], rtol=1e-5, atol=1e-6)
    for column in range(len(INPUT_FIELDS)):
        push = small * np.eye(2)[column]
        slope = (after(np.zeros(5), push) - after(np.zeros(5), -push)) / (2 * small)
        np.testing.assert_allclose(slope, b[:, column], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("steer", [-0.8, -0.1, 0.0, 0.3, 0.8])
def test_steady_lean_balances(steer: float) -> None:
    angle, speed = np.array([steer]), np.array([2.5])
    lean = steady_lean(angle, speed, K)
    state = riding(speed=2.5, steer_angle=steer, lean_angle=lean)
    turn = dynamics.curvatures(angle, K)
    acceleration = dynamics.lean_equation(state, np.zeros(1), speed, turn, K)
    assert acceleration.item() == pytest.approx(0.0, abs=1e-12)
    assert np.sign(lean) == np.sign(steer)


def test_eigenvalues_at_rest_are_those_of_a_pendulum() -> None:
    pole = math.sqrt(K.mass * K.mass_height * K.gravity / K.lean_inertia)
    found = eigenvalues(1e-9, FAITHFUL)
    np.testing.assert_allclose(sorted(found.real), [-pole, 0.0, 0.0, pole], atol=1e-6)


@pytest.mark.parametrize("curvature", [0.1, 0.5])
def test_rolling_backward_turns_the_other_way_on_the_same_circle(curvature: float) -> None:
    """Half the angle of an arc is odd in its length, and a quarter turn at most."""
    lengths = np.array([0.5, 1.0, 2.0, 5.0])
    ahead = dynamics._half_chord(lengths, np.full(4, curvature), np)
    back = dynamics._half_chord(-lengths, np.full(4, curvature), np)
    np.testing.assert_array_equal(back, -ahead)
    assert ahead[0] == pytest.approx(math.asin(0.5 * curvature))
    assert dynamics._half_chord(np.array([1e3]), np.array([1.0]), np)[0] == math.pi / 2
