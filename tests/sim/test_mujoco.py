"""The bicycles in MuJoCo: a second opinion on the Whipple bicycle."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bicycle_common.types import Command, InitialPose
from bicycle_controller.control.lqr import LqrController
from bicycle_controller.evaluation.kicks import Trial, largest
from bicycle_sim.plants import base, registry
from bicycle_sim.plants.base import Plant
from bicycle_sim.plants.mujoco import poses
from bicycle_sim.plants.whipple import catalogue, linear
from bicycle_sim.plants.whipple.parameters import Motor, Road
from bicycle_sim.plants.whipple.plant import WhipplePlant
from bicycle_sim.plants.whipple.steady import on_the_road
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named

pytest.importorskip(
    "mujoco", reason="the extra mujoco is not installed: pip install './bicycle_sim[mujoco]'"
)

from bicycle_sim.plants.mujoco.plant import MujocoPlant

SAMPLE = 0.01
"""s between the states that modes are fitted to."""


def fitted(speed: float) -> np.ndarray:
    """Eigenvalues of lean and steering in MuJoCo, from four small starts of half a second."""
    known = replace(catalogue.load("benchmark").parameters, time_step=SAMPLE)
    plant = MujocoPlant(known)
    zero = np.zeros(4)
    state = plant.initial(zero, zero, zero, np.full(4, speed))
    small = 0.01 * np.eye(4)
    state.lean_angle, state.lean_rate, state.steer_angle, state.steer_rate = small
    state = plant.settled(state)
    rows = []
    for _ in range(60):
        state = plant.step(state, zero, zero, zero)
        rows.append([state.lean_angle, state.lean_rate, state.steer_angle, state.steer_rate])
    path = np.array(rows)[9:].transpose(0, 2, 1)  # the tyres have sunk in
    first, then = path[:-1].reshape(-1, 4), path[1:].reshape(-1, 4)
    step = np.linalg.lstsq(first, then, rcond=None)[0].T
    return np.log(np.linalg.eigvals(step).astype(complex)) / SAMPLE


def test_pedal_and_steering_are_the_whipple_bicycle_s() -> None:
    known = catalogue.load("browser-rider").parameters
    known = replace(known, steering=replace(known.steering, friction=0.1))
    exact, plant = WhipplePlant(known), MujocoPlant(known)
    assert plant.pedal_gear == exact.pedal_gear == known.drive.gear
    assert plant.steer_friction == exact.steer_friction == 0.1


@pytest.mark.parametrize("speed", [4.0, 5.0, 6.0])
def test_the_weave_is_the_whipple_bicycle_s(speed: float) -> None:
    """Modes agree within 0.03 1/s and 1 % of the frequency."""
    exact = linear.eigenvalues(catalogue.load("benchmark").parameters.bicycle, np.array([speed]))[
        0
    ]
    want = exact[exact.imag > 0.1][0]
    modes = fitted(speed)
    found = modes[np.abs(modes - want).argmin()]
    assert found.real == pytest.approx(want.real, abs=0.03)
    assert found.imag == pytest.approx(want.imag, rel=0.01)


def test_poses_come_back_from_mujoco() -> None:
    plant = MujocoPlant(catalogue.load("browser-rider").parameters)
    rng = np.random.default_rng(3)
    whipple = WhipplePlant(plant.parameters)
    start = [*rng.uniform(-5, 5, (2, 50)), rng.uniform(-3, 3, 50), rng.uniform(1, 7, 50)]
    other = whipple.initial(*start)
    for name, size in (
        ("lean_angle", 0.4), ("steer_angle", 0.6), ("lean_rate", 1.0), ("steer_rate", 2.0)
    ):  # fmt: skip
        setattr(other, name, rng.uniform(-size, size, 50))
    other.pitch = on_the_road(whipple.constants, other.lean_angle, other.steer_angle)[0]
    other = whipple.settled(other)
    body = {name: getattr(other, name) for name in base.BodyState.__dataclass_fields__}
    found = poses.from_mujoco(
        plant.parameters.bicycle,
        poses.to_mujoco(plant.parameters.bicycle, whipple.constants, body),
    )
    for name, values in found.items():
        np.testing.assert_allclose(values, getattr(other, name), atol=1e-9, err_msg=name)


def test_a_push_is_recovered_from_as_on_the_whipple_bicycle() -> None:
    zero, paths = np.zeros(1), []
    for kind in (MujocoPlant, WhipplePlant):
        plant: Plant[Any] = kind(catalogue.load("browser-rider").parameters)
        state = plant.pushed(plant.initial(zero, zero, zero, np.full(1, 6.0)), 0.2)
        lean = []
        for _ in range(60):
            state = plant.step(state, zero, zero, zero)
            lean.append(state.lean_angle[0])
        paths.append(lean)
    np.testing.assert_allclose(paths[0], paths[1], atol=2e-3)


def test_kicks_are_caught_as_on_the_whipple_bicycle() -> None:
    """Kicks agree within 10 %, under the same LQR, which knows delay and motor lag."""
    known = replace(
        catalogue.load("browser-rider").parameters, delay=0.05, motor=Motor(lag=0.03, limit=7.0)
    )
    caught = []
    for kind in (MujocoPlant, WhipplePlant):
        plant: Plant[Any] = kind(known)
        trial = Trial(most=80.0, coarse=20.0, fine=4.0, before=3.0, after=3.0)
        lqr = LqrController.named("lqr", plant)
        caught.append(largest(lqr, plant, 3.0, (7.0, 0.0, 0.0), trial).straight[0])
    assert caught[0] == pytest.approx(caught[1], rel=0.1)


def test_the_simulator_goes_on_from_a_message_to_the_bit() -> None:
    known = replace(catalogue.load("benchmark").parameters, delay=0.03, motor=Motor(lag=0.03))
    plant = MujocoPlant(known)
    simulator = Simulator(named("random-start-random-goal"), plant, seed=2)
    states = [simulator.reset(InitialPose(1.0, 2.0, 0.4, 4.0))]
    given = [Command(1, step, 0.3 * np.sin(step), 0.0, 0.0) for step in range(12)]
    states += [simulator.step(command, 0.1 * (step == 5)) for step, command in enumerate(given)]
    known_again = registry.from_dict(json.loads(plant.to_json()))
    again = Simulator.restore(states[4], simulator.scenario, known_again, simulator.seed)
    for step in range(4, 12):
        assert again.step(given[step], 0.1 * (step == 5)) == states[step + 1]


def test_what_it_has_not_is_told() -> None:
    known = catalogue.load("benchmark").parameters
    with pytest.raises(ValueError, match="has not a slope or wind: choose the plant whipple"):
        MujocoPlant(replace(known, road=Road(grade_x=0.1)))
    with pytest.raises(ValueError, match="has not a leaning rider"):
        registry.named("mujoco", "browser-leaning-rider")
    assert registry.named("mujoco", "steer-by-wire").label == "mujoco steer-by-wire"
