"""Transitions from states, commands and goals: live, in pieces, and as the task makes them."""

from __future__ import annotations

import math
from dataclasses import fields

import numpy as np
import pytest

from bicycle_common.nodes import convert
from bicycle_common.types import Command, InitialPose
from bicycle_controller.data.live_steps import LONGEST_WAIT, LiveSteps
from bicycle_controller.data.packing import packed, unpacked
from bicycle_controller.data.transition_builder import TransitionBuilder, Transitions
from bicycle_sim.plants import registry
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named
from bicycle_sim.task.task import BicycleTask

SCENARIO = named("random-start-random-goal")
FAR = (0.0, 500.0)
Point = tuple[float, float]


class Ride:
    """A simulator whose states and echoes go into the builder as messages, as they are made."""

    def __init__(self, plant: str = "choi", heading: float = 0.0) -> None:
        self.simulator = Simulator(SCENARIO, registry.named(plant, None, "faithful"))
        self.simulator.reset(InitialPose(0.0, 0.0, heading, SCENARIO.start_speed))
        self.steps = LiveSteps()
        self.builder = TransitionBuilder(SCENARIO)
        self.say()

    def say(self, echo: bool = True, state: bool = True) -> None:
        """Publish the state, after its echo."""
        here, applied = self.simulator.snapshot, self.simulator.applied
        if echo:
            self.steps.add_echo(convert.from_applied(applied, here.episode, here.step, 0))
        if state:
            self.steps.add_state(convert.from_snapshot(here, 0))

    def step(self, torque: float = 0.0, goal: Point | None = FAR, goal_id: int = 1) -> None:
        here = self.simulator.snapshot
        command = Command(here.episode, here.step, torque, 0.0, 0.0, goal, goal_id, "me", "p")
        self.simulator.step(command)
        self.say()

    def take(self) -> Transitions:
        return self.builder.add(self.steps.take())

    def rest(self) -> Transitions:
        return Transitions.join([self.take(), self.builder.finish()])


def assert_equal(one: Transitions, other: Transitions) -> None:
    for item in fields(one):
        if item.name != "time":
            assert np.array_equal(getattr(one, item.name), getattr(other, item.name)), item.name


def test_transitions_are_the_tasks() -> None:
    task = BicycleTask(SCENARIO, rng=np.random.default_rng(0))
    task.place(np.array([True]), *(np.array([value]) for value in (0.0, 0.0, 0.3, FAR[0], FAR[1])))
    ride = Ride(heading=0.3)
    torques = [0.1, -0.2, 0.3, 0.05, -0.1]
    for torque in torques:
        ride.step(torque)
    found = ride.rest()
    assert len(found) == len(torques)
    before = task.observation()[0]
    for row, torque in enumerate(torques):
        step = task.step(np.array([[torque, 0.0, 0.0]]))
        np.testing.assert_array_equal(found.observation[row], before)
        np.testing.assert_array_equal(found.next_observation[row], step.observation[0])
        assert found.reward[row] == step.reward[0]
        before = step.observation[0]
    assert not found.terminated.any()
    assert found.truncated.tolist() == [False] * 4 + [True]
    assert set(found.policy) == {"p"}


def test_a_new_goal_cuts_and_a_reached_one_ends() -> None:
    ride = Ride()
    ride.step(goal=FAR, goal_id=1)
    assert len(ride.take()) == 0, "the next step will show whether it goes on"
    ride.step(goal=(0.0, 0.0), goal_id=2)
    found = ride.take()
    assert found.truncated.tolist() == [True, False]
    assert found.terminated.tolist() == [False, True]


@pytest.mark.parametrize("reached", [False, True])
def test_a_goal_that_the_controller_calls_reached_ends_its_pursuit(reached: bool) -> None:
    """Whatever radius or heading of arrival the controller goes by."""
    ride = Ride()
    for _ in range(3):
        ride.step(goal=(1.0, 20.0), goal_id=7)
    ride.step(goal=FAR, goal_id=8)
    ends = {(7.0, 1.0, 20.0)} if reached else set()
    found = ride.builder.add(ride.steps.take(), ends)
    assert found.terminated.tolist() == [False, False, reached]
    assert found.truncated.tolist() == [False, False, not reached]


def test_a_fall_inside_the_goal_is_not_counted_as_reached() -> None:
    ride = Ride()
    while not ride.simulator.snapshot.fallen:
        here = ride.simulator.snapshot
        ride.step(1.0, (here.rear_x, here.rear_y), here.step)
    found = ride.rest()
    assert found.fallen.tolist() == [False] * (len(found) - 1) + [True]
    assert not found.terminated[-1]
    assert not found.truncated[-1]


def test_steps_without_a_goal_or_a_command_and_of_a_fallen_bicycle_are_no_transitions() -> None:
    ride = Ride()
    for _ in range(3):
        ride.step()
    ride.simulator.step(None)
    ride.say()
    ride.step(goal=None)
    while not ride.simulator.snapshot.fallen:
        ride.step(2.0)
    last = ride.simulator.snapshot.step
    for _ in range(3):
        ride.step()
    found = ride.rest()
    assert found.step[:4].tolist() == [0, 1, 2, 5]
    assert found.truncated[:3].tolist() == [False, False, True]
    assert found.step[-1] == last - 1
    assert ride.builder.unknown == 0


def test_in_pieces_it_gives_what_it_gives_at_once() -> None:
    rng = np.random.default_rng(3)
    whole, torn = Ride(), Ride()
    parts = []
    for step in range(120):
        goal = (float(step // 30), 300.0)
        torque = float(rng.uniform(-0.3, 0.3))
        for ride in (whole, torn):
            ride.step(torque, goal, step // 30)
        if step % 40 == 39:
            for ride in (whole, torn):
                ride.simulator.reset(InitialPose(0.0, 0.0, 0.2, SCENARIO.start_speed))
                ride.say()
        if rng.random() < 0.4:
            parts.append(torn.take())
    parts.append(torn.rest())
    assert len(parts) > 30
    expected = whole.rest()
    assert expected.truncated.sum() == 6
    assert_equal(Transitions.join(parts), expected)
    for column, name in zip(
        unpacked(packed(expected)), ("observation", "action", "reward"), strict=False
    ):
        assert np.array_equal(column, getattr(expected, name))


def test_a_lost_state_is_counted_and_cuts() -> None:
    ride = Ride()
    for _ in range(4):
        ride.step()
    ride.simulator.step(Command(1, 4, 0.0, 0.0, 0.0, FAR, 1))
    ride.say(state=False)
    for _ in range(3):
        ride.step()
    found = ride.rest()
    assert found.step.tolist() == [0, 1, 2, 3, 6, 7]
    assert found.truncated.tolist() == [False, False, False, True, False, True]
    assert ride.builder.lost == 1


def test_an_echo_may_come_after_its_state_but_is_not_waited_for_for_ever() -> None:
    ride = Ride()
    ride.step()
    ride.simulator.step(Command(1, 1, 0.0, 0.0, 0.0, FAR, 1))
    ride.say(echo=False)
    ride.step()
    assert len(ride.steps.take()["step"]) == 2, "step 2 waits for its echo"
    for _ in range(LONGEST_WAIT):
        ride.step()
    assert len(ride.steps.take()["step"]) == LONGEST_WAIT + 2


def test_repeated_states_and_a_restarted_simulator() -> None:
    ride = Ride()
    for _ in range(3):
        ride.step()
        ride.say()
    ride.simulator = Simulator(SCENARIO)
    ride.simulator.reset(InitialPose(0.0, 0.0, 0.0, SCENARIO.start_speed))
    ride.say()
    ride.step()
    found = ride.rest()
    assert found.step.tolist() == [0, 1, 2, 0]
    assert found.truncated.tolist() == [False, False, True, True]
    assert ride.builder.lost == 0


def test_the_heading_of_a_whipple_bicycle_is_its_rear_wheels() -> None:
    ride = Ride("whipple")
    for _ in range(40):
        ride.step(1.0, (30.0, 10.0))
    here, found = ride.simulator.snapshot, ride.rest()
    bearing = math.atan2(-(30.0 - here.rear_x), 10.0 - here.rear_y)
    error = math.remainder(here.heading - bearing, 2.0 * math.pi)
    assert found.next_observation[-1, 5] == pytest.approx(error, abs=1e-12)
