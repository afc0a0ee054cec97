import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bicycle_controller.control.lqr import LqrController
from bicycle_controller.control.past import Past
from bicycle_controller.evaluation import rollouts as rides_module
from bicycle_controller.evaluation.evaluate import evaluate, wilson
from bicycle_controller.evaluation.rollouts import Disturbance
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import SCENARIOS, Region
from bicycle_sim.task.task import BicycleTask

AHEAD = replace(
    SCENARIOS["fixed-start-fixed-goal"],
    name="ahead",
    start=Region.point(0.0, 0.0),
    goal=Region.point(0.0, 20.0),
    heading_spread=0.0,
)
RANDOM = replace(
    SCENARIOS["random-start-random-goal"],
    start=Region((0.0, 0.0), (40.0, 40.0)),
    goal=Region((0.0, 0.0), (40.0, 40.0)),
    max_steps=800,
)


class Idle:
    """Does nothing, and keeps what it saw."""

    policy_id = "idle"

    def __init__(self, action: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        self.action = action
        self.seen: list[np.ndarray] = []
        self.speeds: list[np.ndarray] = []

    def act(self, observation: np.ndarray, speed: np.ndarray) -> np.ndarray:
        self.seen.append(observation.copy())
        self.speeds.append(speed.copy())
        return np.tile(self.action, (len(observation), 1))


class Circler(LqrController):
    """Turns for ever, as if the goal were always a little to the left."""

    def act(
        self, observation: np.ndarray, speed: np.ndarray, past: Past | None = None
    ) -> np.ndarray:
        turned = observation.copy()
        turned[:, 5] = -0.5
        return super().act(turned, speed, past)


def test_straight_ride_worked_by_hand() -> None:
    # 19 m to the goal's rim in steps of v dt = 10 / 3.6 * 0.025 m: 273.6, so 274 steps.
    result = evaluate(Idle(), AHEAD, episodes=3).summary()
    travel = 274 * 10.0 / 3.6 * 0.025
    expected = {
        "controller": "idle",
        "episodes": 3,
        "seed": 0,
        "reach_rate": 1.0,
        "fall_rate": 0.0,
        "timeout_rate": 0.0,
        "orbit_rate": 0.0,
        "median_time_s": pytest.approx(274 * 0.025),
        "p95_time_s": pytest.approx(274 * 0.025),
        "path_ratio": pytest.approx(travel / 19.0),
        "path_ratio_mean": pytest.approx(travel / 19.0),
        "peak_lean": 0.0,
        "peak_lean_max": 0.0,
        "mean_torque": 0.0,
        "mean_displacement": 0.0,
        "mean_pedal_force": 0.0,
        "mean_speed": pytest.approx(10.0 / 3.6),
        "mean_return": pytest.approx(0.0, abs=1e-20),
    }
    assert {name: result[name] for name in expected} == expected
    assert result["reach_rate_interval"] == list(wilson(3, 3))
    assert result["scenario"]["name"] == "ahead"


def test_step_limit_just_missed_and_just_met() -> None:
    assert evaluate(Idle(), replace(AHEAD, max_steps=274)).summary()["reach_rate"] == 1.0
    late = evaluate(Idle(), replace(AHEAD, max_steps=273), episodes=2).summary()
    assert (late["reach_rate"], late["timeout_rate"], late["orbit_rate"]) == (0.0, 1.0, 0.0)
    assert late["median_time_s"] is late["p95_time_s"] is late["path_ratio"] is None


def test_effort_is_what_the_limits_let_through() -> None:
    scenario = replace(AHEAD, max_steps=3, pedal_limit=50.0)
    rides = evaluate(Idle((-9.0, 0.1, -20.0)), scenario, episodes=2).rides
    np.testing.assert_allclose(rides.torque, 2.0)
    np.testing.assert_allclose(rides.displacement, 0.1)
    np.testing.assert_allclose(rides.pedal_force, 20.0)


def test_fall_ends_the_ride_and_its_reward_repeats() -> None:
    found = evaluate(Idle(), AHEAD, episodes=40, disturbance=Disturbance(initial_tilt=0.05))
    assert found.rides.fallen.all()
    assert found.summary()["fall_rate"] == 1.0
    assert (found.rides.peak_lean > math.pi / 6).all()
    assert (found.rides.steps < 160).all()
    # The same ride with the fallen bicycle kept to the end, as the replay memory sees it.
    task = BicycleTask(AHEAD, ChoiPlant(), 40, np.random.default_rng((0, 0, 0)))
    task.state.lean_angle = task.rng.normal(0.0, 0.05, 40)
    score = np.zeros(40)
    for _ in range(AHEAD.max_steps):
        score += task.step(np.zeros((40, 3))).reward
    np.testing.assert_allclose(found.rides.score, score)


def test_dropping_finished_rides_changes_nothing() -> None:
    count = 60
    found = evaluate(LqrController(), RANDOM, episodes=count, seed=5).rides
    task = BicycleTask(RANDOM, ChoiPlant(), count, np.random.default_rng((5, 0, 0)))
    controller, observation = LqrController(), task.observation()
    steps, reached = np.zeros(count), np.zeros(count, dtype=bool)
    riding = np.ones(count, dtype=bool)
    while riding.any():
        outcome = task.step(controller.act(observation, task.state.speed))
        observation = outcome.observation
        ended = riding & (outcome.terminated | outcome.truncated | outcome.fallen)
        steps[ended], reached[ended] = task.steps[ended], outcome.terminated[ended]
        riding &= ~ended
    np.testing.assert_array_equal(found.steps, steps)
    np.testing.assert_array_equal(found.reached, reached)
    assert reached.mean() > 0.5


def test_same_seed_same_result_other_seed_another() -> None:
    trial = Disturbance(
        roll_kick=0.3, initial_tilt=0.02, displacement_noise=0.01, observation_noise=(0.01,) * 6
    )
    one, two, other = (
        evaluate(LqrController(), RANDOM, episodes=20, seed=seed, disturbance=trial).summary()
        for seed in (3, 3, 4)
    )
    assert one == two
    assert one["mean_return"] != other["mean_return"]


def test_every_controller_meets_the_same_starts() -> None:
    trial = Disturbance(initial_tilt=0.02, observation_noise=(0.1,) * 6)
    rides = [
        evaluate(item, RANDOM, episodes=30, seed=9, disturbance=trial).rides
        for item in (Idle(), LqrController())
    ]
    np.testing.assert_array_equal(rides[0].straight, rides[1].straight)
    assert len(np.unique(rides[0].straight)) == 30


def test_chunks_are_joined_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rides_module, "CHUNK", 8)
    scenario = replace(RANDOM, max_steps=5)
    rides = evaluate(Idle(), scenario, episodes=20).rides
    assert rides.steps.tolist() == [5] * 20
    assert len(np.unique(rides.straight)) == 20


def test_orbit_around_the_goal_is_found() -> None:
    # The circle's centre, a little forward and to the left, is taken from a first ride.
    scenario = replace(AHEAD, max_steps=2400, goal=Region.point(-500.0, 500.0))
    task = BicycleTask(scenario, ChoiPlant(), 1, np.random.default_rng(0))
    controller, places = Circler(), []
    for _ in range(2400):
        task.step(controller.act(task.observation(), task.state.speed))
        places.append((task.state.rear_x[0], task.state.rear_y[0]))
    x, y = np.mean(np.array(places[1200:]), axis=0)
    around = evaluate(Circler(), replace(scenario, goal=Region.point(x, y)), episodes=1)
    turns = around.rides.winding[0] / (2.0 * math.pi)
    assert turns > 2.0, "counter-clockwise, as the bicycle turns left"
    assert around.summary()["orbit_rate"] == around.summary()["timeout_rate"] == 1.0
    beside = evaluate(Circler(), scenario, episodes=1)
    assert abs(beside.rides.winding[0]) < 1.0
    assert (beside.summary()["orbit_rate"], beside.summary()["timeout_rate"]) == (0.0, 1.0)


def test_roll_kick_comes_once_at_its_time_to_both_sides() -> None:
    idle = Idle()
    scenario = replace(AHEAD, max_steps=90)
    evaluate(idle, scenario, episodes=64, disturbance=Disturbance(roll_kick=0.2))
    rates = np.array([seen[:, 3] for seen in idle.seen])
    assert (rates[:81] == 0.0).all()
    np.testing.assert_allclose(np.abs(rates[81]), 0.2, rtol=0.05)
    assert 10 < (rates[81] > 0).sum() < 54


def test_initial_tilt_has_its_spread() -> None:
    idle = Idle()
    scenario = replace(AHEAD, max_steps=1)
    evaluate(idle, scenario, episodes=5000, disturbance=Disturbance(initial_tilt=0.04))
    assert idle.seen[0][:, 2].std() == pytest.approx(0.04, rel=0.05)


def test_observation_noise_is_seen_by_the_controller_only() -> None:
    idle = Idle()
    noise = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    trial = Disturbance(observation_noise=noise)
    rides = evaluate(idle, AHEAD, episodes=2000, disturbance=trial).rides
    assert idle.seen[0].std(axis=0) == pytest.approx(noise, rel=0.1)
    assert (idle.seen[0] != idle.seen[1]).all()
    assert (rides.steps == 274).all()


def test_displacement_noise_leans_the_bicycle() -> None:
    trial = Disturbance(displacement_noise=0.02)
    rides = evaluate(Idle(), replace(AHEAD, max_steps=2), episodes=50, disturbance=trial).rides
    assert len(np.unique(rides.peak_lean)) == 50


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_action_arrives_late(delay: int) -> None:
    idle = Idle((1.0, 0.0, 0.0))
    trial = Disturbance(action_delay=delay)
    evaluate(idle, replace(AHEAD, max_steps=10), disturbance=trial)
    rates = np.array([seen[0, 1] for seen in idle.seen])
    assert np.argmax(rates != 0.0) == delay + 1


def test_delayed_actions_stay_with_their_bicycle() -> None:
    class Labelled(Idle):
        """Only bicycles that lean to the left pedal; they fall to the side they lean to."""

        def act(self, observation: np.ndarray, speed: np.ndarray) -> np.ndarray:
            return super().act(observation, speed) * (observation[:, 2:3] > 0)

    labelled = Labelled((0.0, 0.0, 100.0))
    scenario = replace(AHEAD, pedal_limit=100.0)
    trial = Disturbance(initial_tilt=0.1, action_delay=4)
    evaluate(labelled, scenario, episodes=200, disturbance=trial)
    sizes = [len(seen) for seen in labelled.seen]
    assert sizes[0] == 200
    assert 1 <= sizes[-1] < 20
    for step, (seen, speed) in enumerate(zip(labelled.seen, labelled.speeds, strict=True)):
        pedalled = np.where(seen[:, 2] > 0, max(step - 4, 0), 0)
        np.testing.assert_allclose(speed, 10.0 / 3.6 + pedalled * 20.0 / 76.7 * 0.025)


def test_speed_is_replaced() -> None:
    # 19 m at 5 m/s: 152 steps of 0.125 m. Rounding decides whether the last is needed.
    found = evaluate(Idle(), AHEAD, disturbance=Disturbance(speed=5.0)).summary()
    assert found["median_time_s"] == pytest.approx(3.8, abs=0.026)
    assert found["mean_speed"] == pytest.approx(5.0)


def test_controller_gets_the_speed() -> None:
    idle = Idle((0.0, 0.0, 100.0))
    scenario = replace(AHEAD, pedal_limit=100.0, speed_limits=(1.0, 5.0), max_steps=4)
    evaluate(idle, scenario, episodes=2)
    # F_4 = 0.2 * 100 N on 76.7 kg for 0.025 s each step (equations 11 to 13).
    gain = 20.0 / 76.7 * 0.025
    expected = [10.0 / 3.6 + step * gain for step in range(4)]
    np.testing.assert_allclose([speed[0] for speed in idle.speeds], expected)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"roll_kick": -1.0}, "roll_kick"),
        ({"initial_tilt": math.nan}, "initial_tilt"),
        ({"observation_noise": (0.1, 0.2)}, "observation_noise"),
        ({"observation_noise": (-0.1,) * 6}, "steer_angle"),
        ({"action_delay": 1.5}, "action_delay"),
        ({"action_delay": -1}, "action_delay"),
    ],
)
def test_impossible_disturbance(change: dict[str, Any], expected: str) -> None:
    with pytest.raises(ValueError, match=expected):
        Disturbance(**change)


def test_impossible_evaluation() -> None:
    with pytest.raises(ValueError, match="at least one episode"):
        evaluate(Idle(), AHEAD, episodes=0)
    with pytest.raises(ValueError, match="seed"):
        evaluate(Idle(), AHEAD, seed=-1)
    with pytest.raises(ValueError, match="not finite"):
        evaluate(Idle((math.nan, 0.0, 0.0)), AHEAD)
    with pytest.raises(ValueError, match="start_speed"):
        evaluate(Idle(), SCENARIOS["learned-speed"], disturbance=Disturbance(speed=9.0))
