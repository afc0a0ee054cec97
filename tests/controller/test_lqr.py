"""The classical controller: its gains, its limits, and that it reaches every goal upright."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bicycle_controller.control.lqr import SPEEDS, TUNED, LqrConfig, LqrController, tuned
from bicycle_controller.evaluation.evaluate import evaluate
from bicycle_controller.policy.policy import LQR
from bicycle_sim.plants import registry
from bicycle_sim.plants.choi.linear import discrete
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.plants.whipple import catalogue
from bicycle_sim.plants.whipple.parameters import Motor
from bicycle_sim.plants.whipple.plant import WhipplePlant
from bicycle_sim.task.scenario import Region, Scenario, named
from bicycle_sim.task.task import BicycleTask

CORRECTED = ChoiPlant.named("corrected")
NEAR = Scenario(
    "near",
    start=Region.point(0.0, 0.0),
    goal=Region((-15.0, -15.0), (15.0, 15.0)),
    max_steps=2400,
)
"""Goals at any bearing, so near that a controller may circle round them for ever."""


def observations(count: int, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform(-1.0, 1.0, (count, 6)) * (0.8, 3.0, 0.4, 1.0, 5.0, math.pi)


@pytest.mark.parametrize("plant", [ChoiPlant(), CORRECTED], ids=["faithful", "corrected"])
@pytest.mark.parametrize("name", ["lqr", "lqr-20cm"])
def test_lean_and_steering_are_stable_at_every_speed(name: str, plant: ChoiPlant) -> None:
    config = TUNED[name]
    controller = LqrController(config, plant)
    inputs = 2 if config.use_displacement else 1
    for speed in np.linspace(1.0, 5.0, 41):  # Also between the speeds of the gains.
        a, b = discrete(float(speed), plant.physics)
        unit = 1e-6 * np.eye(4)
        seen = np.zeros((4, 6))
        seen[:, [2, 3, 0, 1]] = unit  # The observation's order is another.
        action = controller.act(seen, np.full(4, speed))[:, :inputs]
        closed = a[:4, :4] + b[:4, :inputs] @ (action.T / 1e-6)
        assert np.abs(np.linalg.eigvals(closed)).max() < 0.995


def test_actions_keep_their_limits() -> None:
    config = LqrConfig(
        use_displacement=True,
        use_pedal=True,
        torque_limit=1.5,
        displacement_limit=0.01,
        pedal_limit=30.0,
    )
    action = LqrController(config).act(5.0 * observations(500), np.linspace(0.5, 6.0, 500))
    assert action.shape == (500, 3)
    np.testing.assert_array_equal(np.abs(action).max(axis=0), [1.5, 0.01, 30.0])


def test_by_default_only_the_handlebar_moves() -> None:
    action = LqrController().act(observations(100), np.full(100, 2.0))
    assert np.abs(action[:, 0]).max() > 0.1
    assert not action[:, 1:].any()


@pytest.mark.parametrize("name", list(LQR))
def test_left_and_right_are_alike(name: str) -> None:
    controller, seen, speed = LqrController(TUNED[name]), observations(200), np.full(200, 2.3)
    np.testing.assert_array_equal(
        controller.act(-seen, speed), controller.act(seen, speed) * (-1.0, -1.0, 1.0)
    )


def test_a_batch_is_its_rows_and_nothing_is_remembered() -> None:
    controller = LqrController(TUNED["lqr-displacement-pedal"])
    seen, speed = observations(20), np.linspace(0.8, 5.5, 20)
    together = controller.act(seen, speed)
    alone = [controller.act(seen[i : i + 1], speed[i : i + 1])[0] for i in range(20)]
    np.testing.assert_allclose(together, alone, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(controller.act(seen, speed), together)


def test_upright_and_straight_at_the_goal_it_does_nothing() -> None:
    assert not LqrController().act(np.zeros((1, 6)), np.array([2.7])).any()


def test_beyond_its_speeds_the_last_gains_hold() -> None:
    controller, seen = LqrController(), 0.01 * observations(1)
    seen[0, 5] = 0.0
    for beyond, last in ((0.2, SPEEDS[0]), (9.0, SPEEDS[-1])):
        np.testing.assert_array_equal(
            controller.act(seen, np.array([beyond])), controller.act(seen, np.array([last]))
        )


def test_the_pedal_slows_down_for_a_turn_and_speeds_up_after() -> None:
    controller = LqrController(LqrConfig(use_pedal=True))
    seen = np.zeros((2, 6))
    seen[:, 5] = (1.5, 0.0)
    forces = controller.act(seen, np.array([2.5, 2.5]))[:, 2]
    assert forces.tolist() == [-100.0, 100.0]


def test_the_policy_id_names_tuning_and_physics() -> None:
    ids = {LqrController(config).policy_id for config in TUNED.values()}
    assert len(ids) == len(TUNED)
    assert LqrController().policy_id == LqrController(LqrConfig()).policy_id
    assert LqrController().policy_id != LqrController(None, CORRECTED).policy_id
    assert LqrController().policy_id.startswith("lqr-")


def test_every_name_is_tuned() -> None:
    assert set(TUNED) == set(LQR)


def score(controller: LqrController, scenario: Scenario, episodes: int, **more: Any) -> Any:
    found = evaluate(controller, scenario, episodes=episodes, seed=11, **more).summary()
    return found["reach_rate"], found["fall_rate"]


@pytest.mark.parametrize("speed", [2.0, 2.4, 10.0 / 3.6])
def test_steering_only_reaches_every_near_goal(speed: float) -> None:
    assert score(LqrController(), replace(NEAR, start_speed=speed), 150) == (1.0, 0.0)


@pytest.mark.parametrize(
    ("name", "scenario"),
    [
        ("lqr", "random-start-random-goal"),
        ("lqr-20cm", "random-start-random-goal"),
        ("lqr-displacement", "random-small-displacement"),
        ("lqr-pedal", "learned-speed"),
        ("lqr-displacement-pedal", "learned-speed"),
    ],
)
def test_reaches_every_goal(name: str, scenario: str) -> None:
    controller, task = LqrController(TUNED[name]), named(scenario)
    assert score(controller, task, 40) == (1.0, 0.0)
    near = replace(task, start=NEAR.start, goal=NEAR.goal, max_steps=NEAR.max_steps)
    assert score(controller, near, 100) == (1.0, 0.0)


@pytest.mark.parametrize("name", ["lqr", "lqr-20cm"])
def test_rides_the_corrected_bicycle_too(name: str) -> None:
    controller = LqrController(TUNED[name], CORRECTED)
    assert score(controller, NEAR, 60, plant=CORRECTED) == (1.0, 0.0)


def reached_from_abeam(config: LqrConfig) -> float:
    """Share of bicycles beside their goal that reach it within a minute."""
    controller = LqrController(config)
    radius = np.linspace(1.6, 6.0, 40)
    scenario = replace(NEAR, max_steps=2400)
    task = BicycleTask(scenario, count=40, rng=np.random.default_rng(0))
    zero, every = np.zeros(40), np.ones(40, dtype=bool)
    task.place(every, zero, zero, zero, radius, zero)  # The goal lies right abeam.
    reached = np.zeros(40, dtype=bool)
    for _ in range(scenario.max_steps):
        reached |= task.step(controller.act(task.observation(), task.state.speed)).terminated
    return float(reached.mean())


def test_a_goal_abeam_is_not_circled_for_ever() -> None:
    assert reached_from_abeam(LqrConfig()) == 1.0
    # A turn that tightens with the error up to a right angle and beyond holds a circle:
    circling = LqrConfig(turn_shape=(1.0,) * 6, state_weights=(6.0, 0.5, 0.05, 0.5, 1.0))
    assert reached_from_abeam(circling) < 0.5


def test_a_goal_right_behind_is_reached() -> None:
    errors = np.linspace(-0.01, 0.01, 41)  # Either side of where the error jumps by a turn.
    task = BicycleTask(replace(NEAR, max_steps=2400), count=41, rng=np.random.default_rng(0))
    zero, every = np.zeros(41), np.ones(41, dtype=bool)
    task.place(every, zero, zero, errors, zero, zero - 8.0)
    controller, reached = LqrController(), np.zeros(41, dtype=bool)
    for _ in range(1600):
        reached |= task.step(controller.act(task.observation(), task.state.speed)).terminated
    assert reached.all()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"torque_weight": 0.0}, "torque_weight must be finite and above zero"),
        ({"tilt_limit": math.nan}, "tilt_limit must be finite and above zero"),
        ({"tilt_limit": 1.6}, "tilt_limit must be below pi/2"),
        ({"steer_limit": 1.6}, "steer_limit must be below pi/2"),
        ({"state_weights": (1.0, 1.0)}, "state_weights needs five numbers"),
        ({"turn_shape": (1.0,) * 5}, "turn_shape needs 6 numbers"),
        ({"turn_shape": (1.0,) * 5 + (-1.0,)}, "turn_shape must be finite and above zero"),
    ],
)
def test_an_impossible_tuning_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        LqrConfig(**changes)


@pytest.mark.parametrize(("shape", "speeds"), [((6,), 1), ((2, 5), 2), ((2, 6), 3)])
def test_a_wrong_shape_is_refused(shape: tuple[int, ...], speeds: int) -> None:
    with pytest.raises(ValueError, match=r"observation must have shape \(N, 6\)"):
        LqrController().act(np.zeros(shape), np.ones(speeds))


@pytest.mark.parametrize("bicycle", ["browser-rider", "steer-by-wire"])
def test_a_bicycle_with_trail_is_held_in_turns_and_circles_no_goal(bicycle: str) -> None:
    plant = registry.named("whipple", bicycle)
    controller = LqrController.named("lqr", plant)
    scenario = named("random-start-random-goal")
    for speed in (10.0 / 3.6, 5.0):
        assert score(controller, replace(scenario, start_speed=speed), 100, plant=plant) == (1, 0)


def test_a_motor_s_limit_is_the_lqr_s() -> None:
    known = catalogue.load("benchmark").parameters
    plant = WhipplePlant(replace(known, motor=Motor(limit=7.0)))
    assert tuned("lqr", plant).torque_limit == 7.0
    assert tuned("lqr", plant, 3.0).torque_limit == 3.0
    assert tuned("lqr", registry.named("whipple")).torque_limit == 2.0
    assert tuned("lqr", ChoiPlant()) is TUNED["lqr"]
