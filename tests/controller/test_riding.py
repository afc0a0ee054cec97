"""Rides under a controller with memory: in the control loop, and thousands at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from remembering import make_remembering

from bicycle_common.types import InitialPose
from bicycle_controller.control.control_loop import ControlLoop
from bicycle_controller.control.goals import GoalTracker
from bicycle_controller.control.past import Past, parameters_of
from bicycle_controller.control.riding import Riding
from bicycle_controller.evaluation.evaluate import evaluate
from bicycle_controller.evaluation.rollouts import Disturbance
from bicycle_sim.plants import registry
from bicycle_sim.plants.whipple.plant import WhipplePlant
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named
from bicycle_sim.task.task import BicycleTask

SCENARIO = named("random-start-random-goal")
PLANT = registry.named("whipple", "browser-rider")


class Recorder:
    """Notes what it is given, and steers a little more each time."""

    policy_id = "recorder"
    plant_parameters: tuple[str, ...] = ()

    def __init__(self, memory: int) -> None:
        self.memory = memory
        self.pasts: list[np.ndarray] = []
        self.seen: list[np.ndarray] = []

    def act(
        self, observation: np.ndarray, speed: np.ndarray, past: Past | None = None
    ) -> np.ndarray:
        assert past is not None
        self.pasts.append(past.rows.copy())
        self.seen.append(observation.copy())
        action = np.zeros((len(speed), 3))
        action[:, 0] = 0.001 * len(self.pasts)
        return action


def test_the_past_is_what_was_seen_and_sent() -> None:
    controller, rng = Recorder(3), np.random.default_rng(0)
    riding = Riding(controller, 2)
    seen, speeds = rng.normal(size=(6, 2, 6)), rng.uniform(1.0, 6.0, (6, 2))
    sent = rng.normal(size=(6, 2, 3))
    for step in range(6):
        for _ in range(2):  # to ask twice changes nothing
            riding.act(seen[step], speeds[step])
        riding.acted(seen[step], speeds[step], sent[step])
    first = controller.pasts[0]
    np.testing.assert_array_equal(first[:, 2, :6], seen[0])
    assert not first[..., 7:].any()
    np.testing.assert_array_equal(controller.pasts[10], controller.pasts[11])
    last = Past(2, 3)
    last.rows = controller.pasts[-1]
    for age in range(3):
        np.testing.assert_array_equal(last.observation[:, age], seen[4 - age])
        np.testing.assert_array_equal(last.speed[:, age], speeds[4 - age])
        np.testing.assert_array_equal(last.action[:, age], sent[4 - age])


def test_a_ride_that_begins_forgets_and_the_others_do_not() -> None:
    controller = Recorder(2)
    riding = Riding(controller, 3)
    for value in (1.0, 2.0):
        seen = np.full((3, 6), value)
        riding.act(seen, np.ones(3))
        riding.acted(seen, np.ones(3), seen[:, :3])
    riding.reset(np.array([False, True, False]))
    riding.keep(np.array([False, True, True]))
    riding.act(np.full((2, 6), 3.0), np.ones(2))
    begun, old = controller.pasts[-1]
    assert (begun[:, 0] == 3.0).all()
    assert not begun[:, 7:].any()
    assert old[:, 0].tolist() == [2.0, 1.0]


def test_parameters_of_the_bicycles() -> None:
    names = ("plant.motor.lag", "plant.bicycle.w")
    assert parameters_of(PLANT, names, 2)[:, 1].tolist() == [1.121, 1.121]
    assert isinstance(PLANT, WhipplePlant)
    data = PLANT.parameters
    many = WhipplePlant(replace(data, motor=replace(data.motor, lag=np.array([0.0, 0.03]))))
    assert parameters_of(many, names, 2)[:, 0].tolist() == [0.0, 0.03]
    with pytest.raises(ValueError, match="has no motor"):
        parameters_of(registry.default(), names, 1)
    with pytest.raises(ValueError, match="has to be told"):
        Riding(make_remembering(names), 1)


def test_loop_and_rollouts_remember_alike() -> None:
    """One ride in the control loop gives the commands of the same ride in the task."""
    policy = make_remembering(("plant.delay", "plant.bicycle.mB"), gain=0.02)
    simulator = Simulator(SCENARIO, PLANT)
    pose = InitialPose(0.0, 0.0, 0.4, 4.0)
    loop = ControlLoop("me", policy, GoalTracker(), SCENARIO.action_limits, plant=PLANT)
    for _ in range(2):  # a new episode begins without the old one's past
        simulator.reset(pose)
        loop.tracker.replace([(0.0, 40.0)])
        commands = []
        for _ in range(30):
            state = simulator.snapshot
            command = loop.answer(state, 0.025 * state.step).command
            assert command is not None
            commands.append(command.torque)
            simulator.step(command)
        task = BicycleTask(SCENARIO, PLANT, 1)
        place = np.zeros(1)
        task.place(np.array([True]), place, place, place + 0.4, place, place + 40.0)
        task.state = PLANT.initial(place, place, place + 0.4, place + 4.0)
        riding, chosen = Riding(policy, 1, PLANT), []
        for _ in range(30):
            seen, speed = task.observation(), task.state.speed
            limits = task.scenario.action_limits
            action = np.clip(riding.act(seen, speed), -limits, limits)
            riding.acted(seen, speed, action)
            chosen.append(float(action[0, 0]))
            task.step(action)
        np.testing.assert_allclose(commands, chosen, atol=1e-9)
        assert np.ptp(chosen) > 0.01


def test_a_loop_repeats_what_nobody_saw() -> None:
    policy = Recorder(4)
    simulator = Simulator(SCENARIO, PLANT)
    simulator.reset(InitialPose(0.0, 0.0, 0.4, 4.0))
    loop = ControlLoop("me", policy, GoalTracker(), SCENARIO.action_limits)
    loop.tracker.replace([(0.0, 40.0)])
    for step in range(6):
        state = simulator.snapshot
        if step != 3:
            simulator.step(loop.answer(state, 0.025 * state.step).command)
        else:
            simulator.step(None)
    assert loop.missed == 1
    rows = policy.pasts[-1][0]
    np.testing.assert_array_equal(rows[1], rows[2])
    assert (rows[0] != rows[1]).any()


def test_a_policy_that_cannot_be_told_is_not_asked() -> None:
    simulator = Simulator(SCENARIO)
    simulator.reset(InitialPose(0.0, 0.0, 0.4, 4.0))
    policy = make_remembering(("plant.motor.lag",))
    loop = ControlLoop("me", policy, GoalTracker(), SCENARIO.action_limits)
    loop.tracker.replace([(0.0, 40.0)])
    answer = loop.answer(simulator.snapshot, 0.0)
    assert answer.command is not None
    assert answer.command.policy == "none"
    assert "cannot ride" in answer.warning


class Follower(Recorder):
    """Checks that the past it is given belongs to the ride that it is given."""

    def act(
        self, observation: np.ndarray, speed: np.ndarray, past: Past | None = None
    ) -> np.ndarray:
        assert past is not None
        before = past.observation[:, 0, 5]
        assert np.abs(np.angle(np.exp(1j * (observation[:, 5] - before)))).max() < 0.3
        return super().act(observation, speed, past)


def test_rides_that_end_leave_the_others_their_past() -> None:
    follower, tilted = Follower(1), Disturbance(initial_tilt=0.1)
    scenario = named("random-start-random-goal")
    rides = evaluate(follower, scenario, PLANT, 40, 3, tilted).rides
    assert len(np.unique(rides.steps)) > 5


def test_rollouts_tell_the_command_that_was_sent() -> None:
    controller = Recorder(2)
    controller.plant_parameters = ()
    evaluate(controller, named("fixed-start-fixed-goal"), PLANT, 3, 1, Disturbance(action_delay=3))
    assert controller.pasts[5][0, 0, 7] == pytest.approx(0.005)
