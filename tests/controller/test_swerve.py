"""Bicycles on the way to goals, and by cmd_vel, keep clear of one another."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from bicycle_common.types import BicycleState, Command, InitialPose
from bicycle_controller.control.control_loop import ControlLoop
from bicycle_controller.control.followers import make
from bicycle_controller.control.goals import GoalTracker
from bicycle_controller.control.keep_clear import Mover
from bicycle_controller.control.swerve import Swerve, pedal_at_most
from bicycle_controller.control.twist_ride import TwistLimits, TwistRide
from bicycle_controller.policy.policy import load_controller
from bicycle_sim.plants import registry
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named

Answer = Callable[[BicycleState, float], Command | None]
RIDER = registry.named(plant="whipple", bicycle="browser-rider")


def mover(x: float, y: float, yaw: float, speed: float = 3.0) -> Mover:
    return Mover(*(np.array([v]) for v in (x, y, yaw - math.pi / 2, speed)))


def seen(state: BicycleState) -> Mover:
    numbers = state.rear_x, state.rear_y, state.heading, state.speed
    return Mover(*(np.array([v]) for v in numbers))


def test_alone_it_asks_for_nothing() -> None:
    swerve = Swerve()
    most, aside = swerve.look(mover(0.0, 0.0, 0.0), 2.0)
    assert math.isinf(most[0])
    assert aside[0] == 0.0
    pedal = np.array([73.25])
    assert pedal_at_most(pedal, np.array([3.0]), most)[0] == 73.25


def test_who_gives_way_slows_down_or_swerves_and_the_other_rides_on() -> None:
    left, right = mover(-15.0, 0.0, 0.0), mover(0.0, -15.0, math.pi / 2)
    for pedals in (True, False):
        gives, rides = Swerve({"b2": right}, "b1"), Swerve({"b1": left}, "b2")
        gives.pedals = rides.pedals = pedals
        most, aside = gives.look(left, 2.0)
        assert gives.yielding[0]
        assert most[0] <= 3.0 if pedals else abs(aside[0]) > 0.1
        assert math.isinf(most[0]) is not pedals
        most, aside = rides.look(right, 2.0)
        assert math.isinf(most[0])
        assert (aside[0], rides.yielding[0]) == (0.0, False)


def test_many_bicycles_at_once_pass_as_one_after_another() -> None:
    rng = np.random.default_rng(1)
    count = 150
    own = Mover(*(np.full(count, value) for value in (0.0, 0.0, 0.3, 3.0)))

    def drawn() -> Mover:
        x, y = rng.uniform(-20.0, 20.0, (2, count))
        return Mover(x, y, rng.uniform(-np.pi, np.pi, count), rng.uniform(2.0, 4.0, count))

    others = {"b1": drawn(), "b3": drawn()}
    for pedals in (True, False):
        together = Swerve(others, "b2")
        together.pedals = pedals
        found = [np.array(together.look(own, 2.0)) for _ in range(2)][-1]
        assert 5 < int(together.yielding.sum()) < 140
        for i in range(count):
            few = {name: Mover(*(v[i : i + 1] for v in one)) for name, one in others.items()}
            alone = Swerve(few, "b2")
            alone.pedals = pedals
            single = [alone.look(Mover(*(v[i : i + 1] for v in own)), 2.0) for _ in range(2)][-1]
            np.testing.assert_allclose(found[:, i], np.array(single)[:, 0], atol=1e-9)


def loop_to(goal: tuple[float, float], policy: str, limits: tuple[float, float, float]) -> Answer:
    """Return the answers of a control loop that rides to a goal."""
    tracker = GoalTracker()
    tracker.replace([goal])
    loop = ControlLoop(policy, load_controller(policy), tracker, np.array(limits))
    loops.append(loop)

    def answer(state: BicycleState, time: float) -> Command | None:
        return loop.answer(state, time).command

    return answer


loops: list[ControlLoop] = []


def least(scenario: str, policy: str, limits: tuple[float, float, float], rule: bool) -> float:
    """Return how near two of the paper's bicycles come whose ways to goals cross, m."""
    loops.clear()
    ways = [((-30.0, 0.0), (40.0, 0.0), -math.pi / 2), ((0.0, -31.0), (0.0, 40.0), 0.0)]
    rides = []
    for start, goal, heading in ways:
        simulator = Simulator(named(scenario), registry.default())
        simulator.reset(InitialPose(*start, heading, 2.5))
        rides.append((simulator, loop_to(goal, policy, limits)))
    for i, loop in enumerate(loops):
        loop.swerve = Swerve({}, f"b{i}")
    nearest = math.inf
    for step in range(900):
        states = [simulator.snapshot for simulator, _ in rides]
        apart = math.hypot(
            states[0].rear_x - states[1].rear_x, states[0].rear_y - states[1].rear_y
        )
        nearest = min(nearest, apart)
        for i, (simulator, answer) in enumerate(rides):
            if rule:
                loops[i].swerve.others = {f"b{1 - i}": seen(states[1 - i])}
            command = answer(states[i], 0.025 * step)
            if command is None:
                return nearest  # one has reached its goal, and is not told where to ride on
            simulator.step(command)
            assert not simulator.snapshot.fallen
    return nearest


@pytest.mark.parametrize(
    ("scenario", "policy", "limits"),
    [
        ("random-start-random-goal", "fixed-speed", (2.0, 0.2, 0.0)),
        ("random-start-random-goal", "lqr", (2.0, 0.2, 0.0)),
        ("learned-speed", "learned-speed", (2.0, 0.02, 100.0)),
    ],
)
def test_two_on_the_way_to_goals_pass_clear_where_blind_ones_touch(
    scenario: str, policy: str, limits: tuple[float, float, float]
) -> None:
    assert least(scenario, policy, limits, rule=False) < 1.0
    assert least(scenario, policy, limits, rule=True) > 1.0


def test_a_lone_bicycle_gets_the_same_commands_to_the_bit() -> None:
    """Somebody far away must not change a command."""
    far = {"b2": mover(900.0, 900.0, 0.0)}
    found = []
    for others in ({}, far):
        loops.clear()
        simulator = Simulator(named("learned-speed"), registry.default())
        simulator.reset(InitialPose(0.0, 0.0, 0.0, 2.5))
        answer = loop_to((20.0, 30.0), "learned-speed", (2.0, 0.02, 100.0))
        loops[0].swerve = Swerve(others, "b1")
        commands = []
        for step in range(300):
            command = answer(simulator.snapshot, 0.025 * step)
            assert command is not None
            commands.append((command.torque, command.displacement, command.pedal_force))
            simulator.step(command)
        found.append(commands)
    assert found[0] == found[1]


def twist_rides(rule: bool) -> tuple[float, list[float]]:
    """Return how near two come that ride straight on by cmd_vel, m, and their last headings."""
    follower = make("preview", RIDER)
    rides = []
    for i, (x, y, heading) in enumerate(((-36.0, 0.0, -math.pi / 2), (0.0, -37.0, 0.0))):
        simulator = Simulator(named("learned-speed"), RIDER)
        simulator.reset(InitialPose(x, y, heading, 3.0))
        guide = TwistRide(follower, TwistLimits())
        guide.swerve = Swerve({}, f"b{i}")
        rides.append((simulator, guide))
    nearest = math.inf
    for step in range(900):
        states = [simulator.snapshot for simulator, _ in rides]
        nearest = min(
            nearest,
            math.hypot(states[0].rear_x - states[1].rear_x, states[0].rear_y - states[1].rear_y),
        )
        for i, (simulator, guide) in enumerate(rides):
            if rule:
                guide.swerve.others = {f"b{1 - i}": seen(states[1 - i])}
            guide.command(3.0, 0.0)
            torque, _, pedal = guide.act(states[i], 0.025 * step)
            state = states[i]
            simulator.step(Command(state.episode, state.step, float(torque), 0.0, float(pedal)))
            assert not simulator.snapshot.fallen
    return nearest, [simulator.snapshot.heading for simulator, _ in rides]


def test_two_by_cmd_vel_pass_clear_and_ride_on_in_their_directions() -> None:
    assert twist_rides(rule=False)[0] < 1.0
    nearest, headings = twist_rides(rule=True)
    assert nearest > 1.0
    assert headings == pytest.approx([-math.pi / 2, 0.0], abs=0.08)
