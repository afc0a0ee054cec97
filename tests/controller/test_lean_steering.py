"""Steering into the lean keeps a real bicycle upright when commands stop, zero torque does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bicycle_common import steer_into_lean
from bicycle_common.types import CommandSource, InitialPose
from bicycle_controller.control.lean_steering import SteerIntoLean
from bicycle_sim.plants.whipple import catalogue
from bicycle_sim.plants.whipple.parameters import Motor
from bicycle_sim.plants.whipple.plant import WhipplePlant
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import Scenario, named

SPEEDS = (1.5, 2.0, 3.0, 4.0, 5.0)


def test_the_law_by_hand() -> None:
    rate, speed = np.array([0.1, -0.1, 0.1, 0.1, 3.0]), np.array([4.0, 4.0, 6.0, 7.0, 2.0])
    found = steer_into_lean.torque(rate, speed, 7.0, 10.0)
    np.testing.assert_allclose(found, [2.0, -2.0, 0.0, 0.0, 7.0])
    seen = np.zeros((5, 6))
    seen[:, 3] = rate
    np.testing.assert_array_equal(SteerIntoLean(7.0, 10.0).act(seen, speed)[:, 0], found)
    with pytest.raises(ValueError, match="gain must be above zero"):
        SteerIntoLean(7.0, 0.0)


def scenario(bicycle: str, gain: float) -> tuple[Scenario, WhipplePlant]:
    known = catalogue.load(bicycle).parameters
    plant = WhipplePlant(replace(known, motor=Motor(limit=7.0)))
    suited = named("random-start-random-goal").with_motor(plant.torque_limit)
    return replace(suited, silence_gain=gain), plant


@pytest.mark.parametrize("bicycle", ["browser-rider", "balance-assist", "steer-by-wire"])
def test_a_simulator_without_commands_steers_into_the_lean(bicycle: str) -> None:
    for gain, stays in ((steer_into_lean.GAIN, True), (0.0, False)):
        simulator = Simulator(*scenario(bicycle, gain))
        simulator.reset(InitialPose(0.0, 0.0, 0.0, 2.0))
        for step in range(400):
            state = simulator.step(None, 0.09 * (step == 0))
        assert state.fallen != stays
        assert simulator.applied.source == CommandSource.ZERO


def test_such_a_ride_goes_on_from_its_message_to_the_bit() -> None:
    suited, plant = scenario("browser-rider", 20.0)
    simulator = Simulator(suited, plant, seed=3)
    begun = simulator.reset(InitialPose(0.0, 0.0, 0.0, 2.0))
    states = [simulator.step(None, 0.1 * (step == 2)) for step in range(30)]
    again = Simulator.restore(begun, Scenario.from_json(suited.to_json()), plant, 3)
    assert [again.step(None, 0.1 * (step == 2)) for step in range(30)] == states


def test_scenarios_of_before_leave_the_handlebar_alone() -> None:
    assert named("learned-speed").silence_gain == 0.0
    with pytest.raises(ValueError, match="silence_gain must be zero or more"):
        replace(named("learned-speed"), silence_gain=-1.0)
