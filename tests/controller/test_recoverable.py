"""Recoverable states of a bicycle, by its unstable mode and its torque limit."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from bicycle_common.types import InitialPose
from bicycle_controller.control.control_loop import ControlLoop
from bicycle_controller.control.goals import GoalTracker
from bicycle_controller.control.lqr import fitting
from bicycle_controller.control.recoverable import farthest, unstable_mode, within_steering
from bicycle_controller.control.safety import LARGEST, Safety, envelope
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.plants.whipple import catalogue
from bicycle_sim.plants.whipple.parameters import Motor
from bicycle_sim.plants.whipple.plant import WhipplePlant
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named


@cache
def plant(delay: float = 0.0, lag: float = 0.0, limit: float = 7.0) -> WhipplePlant:
    known = catalogue.load("browser-rider").parameters
    return WhipplePlant(replace(known, delay=delay, motor=Motor(lag=lag, limit=limit)))


@pytest.mark.parametrize("speed", [1.0, 2.5, 5.0])
def test_beyond_it_full_torque_is_too_little(speed: float) -> None:
    """The paper's bicycle has one real unstable mode, which steps by itself."""
    model = ChoiPlant().linearize(speed, discrete=True)
    mode = unstable_mode(model)
    push = 2.0 * float((mode.vector @ model.b[:, 0]).real)
    for share, grows in ((0.99, False), (1.01, True)):
        begun = now = share * farthest(model, 2.0)
        for _ in range(60):
            now = float(mode.factor.real) * now - abs(push)
        assert (now > begun) == grows


@pytest.mark.parametrize(("delay", "lag", "near"), [(0.05, 0.0, 1e-9), (0.05, 0.03, 0.02)])
@pytest.mark.parametrize("speed", [1.5, 2.0, 3.0])
def test_commands_under_way_count_as_if_they_had_come(
    delay: float, lag: float, near: float, speed: float
) -> None:
    """The extrapolated lean grows by the mode's factor in a period in which no new one is sent."""
    ridden = plant(delay, lag)
    model, layer = ridden.linearize(speed, discrete=True), Safety(plant=ridden)
    place = {name: index for index, name in enumerate(model.states)}
    state = np.zeros(len(model.states))
    torque = model.b[:, model.inputs.index("torque")]
    shares = []
    for sent in (0.0, 0.3, -0.2, 0.25, 0.1, 0.0, 0.0):
        layer.limit(np.array([[sent, 0.0, 0.0]]))
        state = model.a @ state + torque * sent
        seen = [state[place[name]] for name in ("steer_angle", "steer_rate")]
        seen += [state[place[name]] for name in ("lean_angle", "lean_rate")]
        share = layer.extrapolated_lean(np.array([[*seen, 0.0, 0.0]]), np.array([speed]))
        shares.append(float(share[0]))
    growth = abs(unstable_mode(model).factor)
    assert shares[5] / shares[4] == pytest.approx(growth, rel=near)
    assert shares[6] / shares[5] == pytest.approx(growth, rel=near)


def test_it_grows_with_the_torque_and_shrinks_with_delay_and_lag() -> None:
    for speed in (1.5, 2.5):
        plain = farthest(plant().linearize(speed, discrete=True), 7.0)
        double = farthest(plant().linearize(speed, discrete=True), 14.0)
        late = farthest(plant(0.075, 0.03).linearize(speed, discrete=True), 7.0)
        assert double == pytest.approx(2.0 * plain)
        assert 0.5 * plain < late < 0.9 * plain
    assert farthest(plant().linearize(6.0, discrete=True), 7.0) == np.inf


def test_a_turned_handlebar_catches_more_the_faster_it_goes() -> None:
    reach = [within_steering(plant().linearize(speed)) for speed in (1.0, 2.0, 4.0)]
    # A point mass: v^2 / (g w) for a steady turn, and the front's swing.
    assert reach[0] == pytest.approx(0.19, abs=0.02)
    assert reach == sorted(reach)


def test_the_envelope_is_the_bicycle_s() -> None:
    speeds, limits = envelope(plant())
    assert (np.diff(limits) >= 0).all()
    assert limits[-1] == LARGEST
    assert (envelope(plant(0.05, 0.03))[1] <= limits).all()
    assert (envelope(plant(limit=2.0))[1] <= limits).all()
    assert envelope(plant(limit=2.0))[1][0] < 0.5 * limits[0]
    measured = ChoiPlant.safety_envelope
    assert tuple(tuple(row.tolist()) for row in envelope(ChoiPlant())) == measured
    assert speeds[0] == 1.0


class FullTorque:
    policy_id = "full torque"

    def act(self, observation: np.ndarray, speed: np.ndarray) -> np.ndarray:
        return np.tile([7.0, 0.0, 0.0], (len(speed), 1))


@pytest.mark.parametrize("speed", [2.0, 3.0, 5.0])
def test_it_takes_over_in_time_though_commands_come_late(speed: float) -> None:
    """Commands under way count: without them, the LQR gets a bicycle that it cannot save."""
    ridden = plant(0.05, 0.03)
    simulator = Simulator(named("random-start-random-goal").with_motor(7.0), ridden)
    simulator.reset(InitialPose(0.0, 0.0, 0.0, speed))
    limits = simulator.scenario.action_limits
    loop = ControlLoop(
        "me", FullTorque(), GoalTracker(), limits,
        fallback=fitting(limits, ridden), safety=Safety(plant=ridden), plant=ridden,
    )  # fmt: skip
    loop.tracker.replace([(0.0, 400.0)])
    for step in range(400):
        simulator.step(loop.answer(simulator.snapshot, 0.025 * step).command)
    assert not simulator.snapshot.fallen
    assert loop.handed_over > 0
