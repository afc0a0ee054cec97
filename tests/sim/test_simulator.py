"""One bicycle: the task's physics to the bit, restorable from a message, repeatable by seed."""

from __future__ import annotations

import math
import struct
from dataclasses import fields, replace

import numpy as np
import pytest

from bicycle_common.types import (
    AppliedCommand,
    BicycleState,
    Command,
    CommandSource,
    InitialPose,
)
from bicycle_sim.plants import registry
from bicycle_sim.plants.choi.parameters import Physics
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named
from bicycle_sim.task.task import BicycleTask

SCENARIO = named("random-start-random-goal")
LEARNED_SPEED = named("learned-speed")
GOAL = (12.0, -7.0)


def bits(snapshot: BicycleState) -> list[object]:
    """Every field, floats as their bytes, so that NaN equals NaN and 0 differs from -0."""
    values = (getattr(snapshot, item.name) for item in fields(snapshot) if item.compare)
    return [struct.pack("<d", value) if isinstance(value, float) else value for value in values]


def random_commands(seed: int, count: int, size: float = 0.2) -> list[Command | None]:
    rng = np.random.default_rng(seed)
    commands: list[Command | None] = []
    for step in range(count):
        torque, displacement = (float(value) for value in rng.uniform(-size, size, 2))
        pedal = float(rng.uniform(-100, 100))
        command = Command(1, step, torque, 0.1 * displacement, pedal, GOAL, 1, "me", "test")
        commands.append(command if rng.random() > 0.1 else None)
    return commands


def ride(simulator: Simulator, commands: list[Command | None]) -> list[BicycleState]:
    return [simulator.step(command) for command in commands]


def test_it_steps_as_the_task_does() -> None:
    task = BicycleTask(LEARNED_SPEED, rng=np.random.default_rng(5))
    simulator = Simulator(LEARNED_SPEED)
    state = task.state
    start = InitialPose(
        float(state.rear_x[0]),
        float(state.rear_y[0]),
        float(state.heading[0]),
        LEARNED_SPEED.start_speed,
    )
    simulator.reset(start)
    for command in random_commands(1, 60):
        action = command.action if command else (0.0, 0.0, 0.0)
        task.step(np.array([action]))
        snapshot = simulator.step(command)
        for name, values in vars(task.state).items():
            assert getattr(snapshot, name) == float(values[0]), name
        assert snapshot.fallen == bool(task.fallen[0])


@pytest.mark.parametrize("begun", [0, 1, 17])
def test_restored_from_any_state_it_repeats_every_bit(begun: int) -> None:
    plant = ChoiPlant(Physics(displacement_noise=0.01))
    simulator = Simulator(SCENARIO, plant, seed=7)
    commands = random_commands(2, 50)
    states = [simulator.reset(), *ride(simulator, commands)]
    again = Simulator.restore(states[begun], SCENARIO, plant, simulator.seed)
    assert [bits(one) for one in ride(again, commands[begun:])] == [
        bits(one) for one in states[begun + 1 :]
    ]


def test_one_bit_more_torque_is_another_ride() -> None:
    commands = random_commands(2, 50)
    changed = list(commands)
    first = next(index for index, one in enumerate(commands) if one)
    original = commands[first]
    assert original is not None
    changed[first] = replace(original, torque=math.nextafter(original.torque, 9.0))
    rides = []
    for version in (commands, changed):
        simulator = Simulator(SCENARIO)
        simulator.reset(InitialPose(0, 0, 0.3, 2.5))
        rides.append(ride(simulator, version))
    assert bits(rides[0][-1]) != bits(rides[1][-1])


def test_the_seed_alone_decides_start_and_noise() -> None:
    plant = ChoiPlant(Physics(displacement_noise=0.02))
    rides = []
    for seed in (4, 4, 5):
        simulator = Simulator(SCENARIO, plant)
        rides.append([simulator.reset(seed=seed), *ride(simulator, [None] * 20)])
    assert [bits(one) for one in rides[0]] == [bits(one) for one in rides[1]]
    assert bits(rides[0][0]) != bits(rides[2][0])
    assert rides[0][-1].lean_angle != rides[2][-1].lean_angle


def test_each_episode_has_the_next_seed_unless_one_is_named() -> None:
    simulator = Simulator(SCENARIO, seed=10)
    seeds = []
    for asked in (None, None, 3, None):
        snapshot = simulator.reset(seed=asked)
        seeds.append((snapshot.episode, simulator.seed))
    assert seeds == [(1, 10), (2, 11), (3, 3), (4, 4)]


def test_where_the_input_came_from_is_told() -> None:
    simulator = Simulator(SCENARIO)
    simulator.reset()
    assert simulator.applied == AppliedCommand(CommandSource.INITIAL)
    command = Command(1, 0, 0.0, 0.0, 0.0, GOAL, 1, "me")
    inputs = []
    for given in (command, command, None):
        simulator.step(given)
        inputs.append(simulator.applied)
    fresh, held, zero = inputs
    assert (fresh.source, fresh.controller, fresh.lateness(1)) == (CommandSource.FRESH, "me", 0.0)
    assert (held.source, held.controller, held.lateness(2)) == (CommandSource.HELD, "me", 1.0)
    assert (zero.source, zero.controller, zero.lateness(3)) == (CommandSource.ZERO, "", math.inf)
    assert fresh.goal == held.goal == GOAL
    assert zero.goal is None
    simulator.reset()
    assert simulator.applied.lateness(0) == 0.0


def test_the_rates_and_the_pitch_are_the_plants() -> None:
    simulator = Simulator(SCENARIO, registry.named("whipple", None, "faithful"))
    simulator.reset(InitialPose(0.0, 0.0, 0.0, 3.0))
    before = after = simulator.snapshot
    for step in range(20):
        before, after = simulator.snapshot, simulator.step(Command(1, step, 1.0, 0.0, 0.0))
    turned = math.remainder(after.heading - before.heading, 2.0 * math.pi) / simulator.time_step
    assert after.yaw_rate == pytest.approx(turned, rel=0.1)
    assert 0.0 < abs(after.pitch) < 0.1
    assert not after.estimated


def test_a_fallen_bicycle_stays_as_it_lies() -> None:
    simulator = Simulator(SCENARIO)
    simulator.reset(InitialPose(0.0, 0.0, 0.0, 2.5))
    push = Command(1, 0, 0.0, 0.2, 0.0)
    snapshot = simulator.snapshot
    for _ in range(400):
        snapshot = simulator.step(push)
        if snapshot.fallen:
            break
    assert snapshot.fallen
    lying = simulator.step(push)
    assert lying.step == snapshot.step + 1
    assert (lying.lean_angle, lying.rear_x) == (snapshot.lean_angle, snapshot.rear_x)
    assert not simulator.reset().fallen


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ((math.nan, 0, 0, 2), "x must be finite"),
        ((0, math.inf, 0, 2), "y must be finite"),
        ((1e6, 0, 0, 2), "must lie within"),
        ((0, 0, 0, 50), "speed must be 0 to"),
        ((0, 0, 0, -1), "speed must be 0 to"),
    ],
)
def test_an_impossible_start_is_refused(values: tuple[float, ...], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        InitialPose(*values)


def test_a_start_outside_the_scenarios_speeds_changes_nothing() -> None:
    simulator = Simulator(LEARNED_SPEED, seed=3)
    before = simulator.reset()
    with pytest.raises(ValueError, match="1 to 5 m/s"):
        simulator.reset(InitialPose(0, 0, 0, 7.0))
    assert simulator.snapshot is before
    assert simulator.seed == 3


def test_a_negative_seed_is_refused() -> None:
    with pytest.raises(ValueError, match="zero or more"):
        Simulator(SCENARIO).reset(seed=-1)
