"""The layer between policy and bicycle: when it takes over, when it gives back, what it saves."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from faulty_policies import FAULTS, ride

from bicycle_common.types import Command, CommandSource, InitialPose
from bicycle_controller.control import followers, recoverable, safety
from bicycle_controller.control.control_loop import ControlLoop
from bicycle_controller.control.control_output import ControllerSwitch
from bicycle_controller.control.goals import GoalTracker, Status
from bicycle_controller.control.lqr import LqrController, fitting
from bicycle_controller.control.safety import (
    STOP_SPEED,
    HandOverReason,
    Safety,
    SafetyConfig,
    unstable_mode,
)
from bicycle_controller.nodes.controller_settings import ControllerSettings
from bicycle_controller.policy.policy import load_controller
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import BodyState as State
from bicycle_sim.plants.choi.linear import eigenvalues
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import Region, named

SHIPPED = {
    "fixed-speed": "random-start-random-goal",
    "small-displacement": "random-small-displacement",
    "learned-speed": "learned-speed",
}
STEERING = ("not a number", "constant full", "random", "bang-bang at 40 Hz", "bang-bang at 1 Hz")
NONE = np.zeros(1)
SPEED = np.array([2.75])


def state(lean: float = 0.0, lean_rate: float = 0.0) -> np.ndarray:
    return np.array([[0.0, 0.0, lean, lean_rate, 0.0, 0.0]])


def upright() -> np.ndarray:
    return state()


class Faulty:
    """Policy for one bicycle that fails when the test says so."""

    policy_id = "faulty"

    def __init__(self, *action: float) -> None:
        self.sound = LqrController()
        self.action: tuple[float, ...] | None = action or None

    def act(self, observation: np.ndarray, speed: np.ndarray) -> np.ndarray:
        return (
            self.sound.act(observation, speed) if self.action is None else np.array([self.action])
        )


# The measure.


@pytest.mark.parametrize("speed", [1.0, 2.0, 2.75, 5.0])
def test_the_extrapolated_lean_grows_as_the_unstable_pole_says(speed: float) -> None:
    """Over one step without input it grows by the pole's factor, from any small state."""
    plant, layer = ChoiPlant(), Safety()
    small = np.array([1e-5, -2e-5, 1.5e-5, 3e-5])
    lean, lean_rate, steer, steer_rate = (np.array([value]) for value in small)
    still, v = np.zeros(1), np.array([speed])
    before = State(
        lean, lean_rate, still, steer, steer_rate, still, still, still + 1.111, still, still, v
    )
    after = plant.step(before, still, still, still)

    def seen(one: State) -> np.ndarray:
        return np.stack(
            [one.steer_angle, one.steer_rate, one.lean_angle, one.lean_rate, still, still], axis=1
        )

    growth = layer.extrapolated_lean(seen(after), v) / layer.extrapolated_lean(seen(before), v)
    pole = eigenvalues(speed, plant.physics)[0].real
    assert growth[0] == pytest.approx(math.exp(pole * 0.025), rel=0.03)


def test_a_lean_at_rest_is_its_own_extrapolated_lean() -> None:
    assert Safety().extrapolated_lean(state(0.2), SPEED)[0] == pytest.approx(0.2)
    assert unstable_mode(2.0, ChoiPlant.named("corrected")).shape == (4,)


def test_below_and_beyond_the_speeds_of_the_mode_its_ends_hold() -> None:
    layer, leaning = Safety(), state(0.1, 0.2)
    leaning[0, 0] = 0.05
    for speed, end in ((0.2, 1.0), (8.4, 8.0), (30.0, 8.0)):
        assert layer.extrapolated_lean(leaning, np.array([speed])) == layer.extrapolated_lean(
            leaning, np.array([end])
        )


@pytest.mark.parametrize(
    ("torque", "steering", "limit"), [(0.4, 9.0, 0.14), (9.0, 0.6, 0.3), (9.0, 9.0, 0.5)]
)
def test_elsewhere_the_envelope_is_the_least_of_three(
    monkeypatch: pytest.MonkeyPatch, torque: float, steering: float, limit: float
) -> None:
    """The bounds are the torque's, the handlebar's, and a lean short of lying."""
    monkeypatch.setattr(recoverable, "farthest", lambda model, torque_limit: torque)
    monkeypatch.setattr(recoverable, "within_steering", lambda model: steering)
    speeds, found = safety.envelope(registry.named("whipple", "browser-rider"))
    assert (speeds[0], speeds[-1]) == (1.0, 8.0)
    np.testing.assert_allclose(found, limit)


# Taking over and giving back.


@pytest.mark.parametrize(
    ("observation", "speed", "age", "reason"),
    [
        (state(), 2.75, 0.0, HandOverReason.NONE),
        (state(0.45), 2.75, 0.0, HandOverReason.NONE),
        (state(0.47), 2.75, 0.0, HandOverReason.EXTRAPOLATED_LEAN),
        (state(0.2), 1.2, 0.0, HandOverReason.EXTRAPOLATED_LEAN),
        (state(0.55, -0.3), 2.75, 0.0, HandOverReason.LEAN),
        (state(-0.51, 0.52), 2.75, 0.0, HandOverReason.LEAN_RATE),
        (state(), 1.0, 0.0, HandOverReason.TOO_SLOW),
        (state(), 6.0, 0.0, HandOverReason.TOO_FAST),
        (state(), 2.75, 10.0, HandOverReason.NONE),
        (state(), 2.75, 11.0, HandOverReason.STALE),
        (state(), 2.75, math.inf, HandOverReason.STALE),
        (state(math.nan), 2.75, 0.0, HandOverReason.EXTRAPOLATED_LEAN),
    ],
)
def test_it_takes_over_beyond_each_limit(
    observation: np.ndarray, speed: float, age: float, reason: HandOverReason
) -> None:
    layer = Safety()
    assert layer.judge(observation, np.array([speed]), np.array([age]))[0] == reason
    assert layer.hand_overs[0] == (reason is not HandOverReason.NONE)


@pytest.mark.parametrize(("hold", "steps"), [(1.0, 19), (3.0, 59)])
def test_it_gives_back_after_the_hold_and_only_to_a_calm_bicycle(hold: float, steps: int) -> None:
    layer = Safety(SafetyConfig(hold=hold))
    layer.judge(state(0.47), SPEED, NONE)
    for _ in range(200):  # within the envelope, but not calm
        assert layer.judge(state(0.3), SPEED, NONE)[0] == HandOverReason.EXTRAPOLATED_LEAN
    held = 0
    while layer.judge(upright(), SPEED, NONE)[0]:
        held += 1
    assert held == steps, "half the hold of calm, the hold is over already"


def test_at_the_edge_of_the_envelope_it_does_not_chatter() -> None:
    """A state that trembles about the limit changes hands once, not at every step."""
    layer, changes, last = Safety(), 0, 0
    for index in range(400):
        reason = int(layer.judge(state(0.46 + 0.01 * (-1) ** index), SPEED, NONE)[0])
        changes += reason != last
        last = reason
    assert changes == 1


def test_a_policy_that_fails_again_waits_twice_as_long_each_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(safety, "LONGEST_HOLD", 4.0)
    layer, held = Safety(), []
    for _ in range(5):
        layer.judge(state(0.47), SPEED, NONE)
        count = 1
        while layer.judge(upright(), SPEED, NONE)[0]:
            count += 1
        held.append(count)
    assert held == [40, 80, 160, 160, 160]
    for _ in range(385):
        layer.judge(upright(), SPEED, NONE)
    layer.judge(state(0.47), SPEED, NONE)
    count = 1
    while layer.judge(upright(), SPEED, NONE)[0]:
        count += 1
    assert count == 160, "not trusted yet after 9.6 s"
    for _ in range(400):
        layer.judge(upright(), SPEED, NONE)
    layer.judge(state(0.47), SPEED, NONE)
    count = 1
    while layer.judge(upright(), SPEED, NONE)[0]:
        count += 1
    assert count == 40, "trusted again after 10 s"


def test_the_first_failure_is_held_for_the_shortest_time() -> None:
    """Also that of a policy that gives no action at all, before any state was judged."""
    layer = Safety(SafetyConfig(hold=0.1))
    assert layer.fail(np.array([True])) == HandOverReason.POLICY
    assert waited(layer) == 4


def waited(layer: Safety) -> int:
    """Return how many calm steps the fallback drives."""
    for count in range(10_000):
        if layer.judge(upright(), SPEED, NONE)[0] == HandOverReason.NONE:
            return count + 1
    raise AssertionError("it drives on")


def test_one_bicycles_trouble_is_not_anothers() -> None:
    """The second is trusted again after its own quiet time, while the first is never calm."""
    layer = Safety(SafetyConfig(hold=0.1), count=2)
    speeds, ages = SPEED.repeat(2), NONE.repeat(2)
    wild, calm = np.concatenate([state(0.6), state()]), np.concatenate([state(0.6)] * 2)

    def hold() -> int:
        layer.judge(calm, speeds, ages)
        assert layer.reason[1] != HandOverReason.NONE
        for count in range(1000):
            if layer.judge(wild, speeds, ages)[1] == HandOverReason.NONE:
                return count + 1
        raise AssertionError("it drives on")

    first = hold()
    soon = hold()
    assert soon > first
    for _ in range(500):  # s 12.5
        layer.judge(wild, speeds, ages)
    assert layer.reason.tolist() == [HandOverReason.EXTRAPOLATED_LEAN, HandOverReason.NONE]
    assert hold() == first


def test_changes_of_the_command_are_limited_by_the_time_that_passed() -> None:
    layer = Safety(SafetyConfig(rates=(20.0, 4.0, 1000.0)))
    first = np.array([[0.1, 0.0, 0.0]])
    assert (layer.limit(first) == first).all()
    cut = layer.limit(np.array([[2.0, -0.2, 100.0]]))
    np.testing.assert_allclose(cut, [[0.6, -0.1, 25.0]])
    np.testing.assert_allclose(layer.limit(np.array([[2.0, -0.2, 100.0]]), 2), [[1.6, -0.2, 75]])
    assert layer.limited[0] == 2
    layer.reset()
    full = np.array([[2.0, -0.2, 100.0]])
    assert (layer.limit(full) == full).all(), "a new episode begins with any command"


@pytest.mark.parametrize("name", ["envelope", "lean", "hold", "slowest"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_a_limit_that_makes_no_sense_is_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name} must be finite and above zero"):
        SafetyConfig(**{name: value})  # type: ignore[arg-type]


# Ordinary rides are untouched.


def commands(actor: str, layer: Safety | None, seed: int, steps: int = 700) -> list[Command]:
    """Return the commands of one bicycle's ride, by the control loop that the node uses."""
    scenario = named(SHIPPED[actor])
    simulator = Simulator(scenario, seed=seed)
    simulator.reset()
    rider = ControlLoop(
        "me",
        load_controller(actor),
        GoalTracker(),
        scenario.action_limits,
        fallback=fitting(scenario.action_limits, ChoiPlant()),
        safety=layer,
    )
    here = (simulator.snapshot.rear_x, simulator.snapshot.rear_y)
    goals = here + np.random.default_rng(seed).uniform(-15, 15, (20, 2))
    rider.tracker.replace([(float(x), float(y)) for x, y in goals])
    given = []
    for _ in range(steps):
        now = simulator.snapshot
        answer = rider.answer(now, now.step * 0.025, simulator.applied)
        assert answer.command is not None
        assert answer.hand_over is None
        given.append(answer.command)
        simulator.step(answer.command)
    return given


@pytest.mark.parametrize("actor", SHIPPED)
def test_the_layer_changes_no_bit_of_an_ordinary_ride(actor: str) -> None:
    layer = ControllerSettings().make_safety(ChoiPlant())
    assert layer is not None
    assert commands(actor, layer, seed=3) == commands(actor, None, seed=3)
    assert layer.limited[0] == layer.hand_overs[0] == 0


def test_by_default_a_command_may_change_by_its_full_range_in_one_step() -> None:
    layer, largest = Safety(), np.array([[2.5, 0.25, 125.0]])
    layer.limit(-largest)
    assert (layer.limit(largest) == largest).all()
    assert (layer.limit(-2.0 * largest) == -largest).all()
    assert layer.limited.tolist() == [1]


@pytest.mark.parametrize(
    ("speed", "limit"),
    [(1.0, 0.12), (1.25, 0.145), (2.0, 0.25), (2.5, 0.38), (2.75, 0.46), (3.5, 0.5), (9.0, 0.5)],
)
def test_the_envelope_is_the_one_that_was_measured(speed: float, limit: float) -> None:
    assert np.interp(speed, *safety.envelope(ChoiPlant())) == pytest.approx(limit)


def test_the_envelope_is_given_for_rising_speeds_and_widens() -> None:
    speeds, leans = safety.envelope(ChoiPlant())
    assert (np.diff(speeds) > 0).all()
    assert (np.diff(leans) >= 0).all()


# Faulty policies.


@pytest.mark.parametrize("actor", SHIPPED)
@pytest.mark.parametrize("fault", STEERING)
def test_with_the_layer_a_faulty_policy_stays_upright(actor: str, fault: str) -> None:
    """The rates over long rides, to the goal, are in tests/benchmarks/results/safety.json."""
    near = Region((0.0, 0.0), (30.0, 30.0))
    scenario = replace(named(SHIPPED[actor]), start=near, goal=near, max_steps=320)
    policy, layer = load_controller(actor), Safety(count=16)
    fallback = fitting(scenario.action_limits, ChoiPlant())
    guarded = ride(policy, FAULTS[fault], scenario, 16, 5, layer, fallback)
    assert guarded.fallen.sum() == 0
    assert (guarded.hand_overs > 0).all()
    if fault != "not a number":
        bare = ride(policy, FAULTS[fault], scenario, 16, 5)
        assert bare.fallen.sum() >= 14


# What the driver makes of it.


def driver(policy: object, **changes: object) -> tuple[ControlLoop, Simulator]:
    scenario = replace(named("learned-speed"), start_speed=2.5)
    simulator = Simulator(scenario)
    simulator.reset(InitialPose(0.0, 0.0, 0.0, 2.5))
    config = SafetyConfig(**changes)  # type: ignore[arg-type]
    limits = scenario.action_limits
    loop = ControlLoop(
        "me",
        policy,  # type: ignore[arg-type]
        GoalTracker(),
        limits,
        fallback=fitting(limits, ChoiPlant()),
        safety=Safety(config),
    )
    loop.tracker.replace([(0.0, 60.0)])
    return loop, simulator


def drive(
    loop: ControlLoop, simulator: Simulator, steps: int
) -> tuple[list[ControllerSwitch], list[Status]]:
    switches, events = [], []
    for _ in range(steps):
        now = simulator.snapshot
        answer = loop.answer(now, now.step * 0.025, simulator.applied)
        events += [event.status for event in answer.events]
        if answer.hand_over is not None:
            switches.append(answer.hand_over)
        simulator.step(answer.command)
    return switches, events


def test_each_change_of_hands_is_told_once_with_its_reason() -> None:
    policy = Faulty()
    loop, simulator = driver(policy)
    assert drive(loop, simulator, 40) == ([], [Status.ACTIVE])
    policy.action = (2.0, 0.0, 0.0)
    (taken,), _ = drive(loop, simulator, 30)
    assert taken.reason is HandOverReason.EXTRAPOLATED_LEAN
    assert "rad is beyond" in taken.message
    assert taken.policy == loop.driving == fitting(loop.limits, ChoiPlant()).policy_id
    assert taken.step > 40
    policy.action = None
    (given,), _ = drive(loop, simulator, 200)
    assert (given.reason, given.policy, loop.driving) == (HandOverReason.NONE, "faulty", "")
    assert given.count == 1
    assert not simulator.snapshot.fallen


def test_a_policy_that_gives_no_number_is_told_once_and_tried_again() -> None:
    loop, simulator = driver(Faulty(math.nan, 0.0, 0.0))
    switches, _ = drive(loop, simulator, 100)
    assert [one.reason for one in switches] == [
        HandOverReason.POLICY,
        HandOverReason.NONE,
        HandOverReason.POLICY,
    ][: len(switches)]
    assert "not finite" in switches[0].message
    assert loop.handed_over == 100, "no step went without the fallback's answer"


def test_a_commanded_stop_slows_down_and_waits_for_a_new_goal() -> None:
    policy = Faulty(2.0, 0.0, 0.0)
    loop, simulator = driver(policy, stop=True)
    switches, events = drive(loop, simulator, 600)
    assert [one.stop for one in switches] == [True]
    assert "send a new goal" in switches[0].message
    assert events == [Status.ACTIVE, Status.CANCELLED]
    assert simulator.snapshot.speed == pytest.approx(STOP_SPEED, abs=0.05)
    assert not simulator.snapshot.fallen
    policy.action = None
    loop.tracker.replace([(20.0, 80.0)])
    (given,), _ = drive(loop, simulator, 40)
    assert (given.reason, given.stop) == (HandOverReason.NONE, False)


def test_a_new_policy_and_a_new_episode_are_trusted_at_once() -> None:
    loop, simulator = driver(Faulty(2.0, 0.0, 0.0))
    drive(loop, simulator, 30)
    assert loop.driving
    loop.policy = Faulty()
    drive(loop, simulator, 1)
    assert not loop.driving
    loop.policy = Faulty(2.0, 0.0, 0.0)
    drive(loop, simulator, 40)
    simulator.reset(InitialPose(0.0, 0.0, 0.0, 2.5))
    loop.tracker.replace([(0.0, 60.0)])
    drive(loop, simulator, 1)
    assert not loop.driving


def test_a_step_without_command_is_stale() -> None:
    loop, simulator = driver(Faulty())
    drive(loop, simulator, 5)
    simulator.step(None)
    assert simulator.applied.source is CommandSource.ZERO
    (taken,), _ = drive(loop, simulator, 1)
    assert taken.reason is HandOverReason.STALE
    assert taken.message.startswith("no command led to the state: lqr-")


@pytest.mark.parametrize("bicycle", ["benchmark", "browser-rider"])
@pytest.mark.parametrize("speed", [2.5, 4.0])
def test_a_steady_turn_is_beside_nothing(bicycle: str, speed: float) -> None:
    plant = registry.named(plant="whipple", bicycle=bicycle)
    follower, layer = followers.make("preview", plant), Safety(None, plant)
    turns = follower.turns(speed, 0.0, 0.05)
    seen, there = np.zeros((1, 6)), np.array([speed])
    seen[:, 0], seen[:, 2] = turns.left * turns.steer, turns.left * turns.lean
    layer.limit(np.array([[float(turns.left[0] * turns.torque[0]), 0.0, 0.0]]), 8)
    beyond, left = layer.beside(seen, there, turns)
    assert layer.extrapolated_lean(seen, there) > 20.0 * beyond
    assert 0.2 <= left < 1.0
    # In the other direction the same turn is a fall.
    other, _ = layer.beside(-seen, there, turns)
    assert other >= layer.extrapolated_lean(seen, there) * 0.9
