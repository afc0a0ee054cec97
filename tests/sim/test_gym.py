"""The Gymnasium face: Gymnasium's own checker, units, ends and seeds."""

from __future__ import annotations

import math
import re
import subprocess
import sys
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bicycle_sim.plants.choi.parameters import Constants
from bicycle_sim.task.scenario import SCENARIOS, Region, Scenario, named

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.spaces import Box  # noqa: E402
from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402

from bicycle_sim.task.gym_env import AUTHORS_SCALE, BicycleEnv, BicycleVectorEnv  # noqa: E402
from bicycle_sim.task.registration import REWARD_THRESHOLDS  # noqa: E402
from bicycle_sim.task.render import Renderer  # noqa: E402
from bicycle_sim.task.scene import Scene  # noqa: E402

NEAR = Scenario(
    "near", Region.point(0.0, 0.0), Region.point(0.0, 1.4), heading_spread=0.0, max_steps=30
)
FAR = replace(NEAR, name="far", goal=Region.point(0.0, 100.0))


@pytest.mark.parametrize(
    "kwargs",
    [
        {},
        {"scenario": "learned-speed", "observation_scale": AUTHORS_SCALE},
        {"scenario": "learning-to-turn-fixed-speed", "physics": "corrected"},
        {"scenario": "fixed-start-fixed-goal", "fall": "terminate"},
    ],
)
def test_passes_gymnasiums_checker_without_warnings(kwargs: dict[str, Any]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make("BicycleGoal-v0", **kwargs)
        check_env(env.unwrapped)
        env.close()


@pytest.mark.parametrize("mode", ["vector_entry_point", "sync"])
def test_many_at_once(mode: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        envs = gymnasium.make_vec("BicycleGoal-v0", num_envs=3, vectorization_mode=mode)
    observation, info = envs.reset(seed=1)
    assert observation in envs.observation_space
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    envs.action_space.seed(1)
    for _ in range(50):
        observation, reward, terminated, truncated, info = envs.step(envs.action_space.sample())
        assert observation in envs.observation_space
        assert reward.shape == terminated.shape == truncated.shape == (3,)
        assert info["goal_distance"].shape == (3,)
        assert info["_goal_distance"].all()
    assert isinstance(envs, BicycleVectorEnv) == (mode == "vector_entry_point")
    envs.close()


def test_both_faces_tell_the_same() -> None:
    one, many = BicycleEnv(FAR), BicycleVectorEnv(2, FAR)
    _, info = one.reset(seed=1)
    _, infos = many.reset(seed=1)
    assert set(info) == {key for key in infos if not key.startswith("_")}
    for torque in np.linspace(-1.0, 1.0, 25, dtype=np.float32):
        action = np.array([torque, -torque / 2], np.float32)
        found = one.step(action)
        batch = many.step(np.tile(action, (2, 1)))
        for index in range(2):
            np.testing.assert_array_equal(batch[0][index], found[0])
            assert batch[1][index] == found[1]
            assert {key: batch[4][key][index] for key in found[4]} == found[4]


@pytest.mark.parametrize(
    ("scenario", "names"),
    [
        ("random-start-random-goal", ("torque", "displacement")),
        ("learned-speed", ("torque", "displacement", "pedal_force")),
        (
            replace(FAR, torque_limit=0.0, pedal_limit=50.0, displacement_limit=0.0),
            ("pedal_force",),
        ),
    ],
)
def test_an_action_is_a_share_of_each_limit(
    scenario: str | Scenario, names: tuple[str, ...]
) -> None:
    env = BicycleEnv(scenario)
    assert env.action_names == names
    assert env.action_space.shape == (len(names),)
    env.reset(seed=2)
    before = env.task.state
    env.step(np.full(len(names), 0.5, np.float32))
    limits = env.task.scenario.action_limits
    k = Constants()
    torque = env.task.state.steer_rate.item() * k.tyre_steer_inertia / k.time_step
    assert torque == pytest.approx(0.5 * limits[0])
    force = (env.task.state.speed - before.speed).item() / k.time_step * k.driven_mass / 0.2
    assert force == pytest.approx(0.5 * limits[2], abs=1e-9)
    lean = env.task.state.lean_acceleration.item() * k.lean_inertia
    tilt = math.atan(0.5 * limits[1] / k.mass_height)
    assert lean == pytest.approx(k.mass * k.mass_height * k.gravity * math.sin(tilt))


def test_only_the_goal_terminates_and_time_truncates() -> None:
    env = BicycleEnv(NEAR)
    env.reset(seed=0)
    ends = [env.step(np.zeros(2, np.float32))[2:4] for _ in range(6)]
    # 1.4 m less 1 m at 0.0694 m a step: six steps.
    assert ends == [(False, False)] * 5 + [(True, False)]
    env = BicycleEnv(FAR)
    env.reset(seed=0)
    ends = [env.step(np.zeros(2, np.float32))[2:4] for _ in range(30)]
    assert ends == [(False, False)] * 29 + [(False, True)]


@pytest.mark.parametrize("fall", ["freeze", "terminate"])
def test_a_fall_freezes_or_terminates(fall: str) -> None:
    env = BicycleEnv(FAR, fall=fall)
    env.reset(seed=0)
    env.task.state = replace(env.task.state, lean_angle=np.array([0.6]))
    observation, reward, terminated, truncated, info = env.step(np.zeros(2, np.float32))
    assert info["fallen"] is True
    assert (terminated, truncated) == (fall == "terminate", False)
    if fall == "freeze":
        again = env.step(np.ones(2, np.float32))
        np.testing.assert_array_equal(again[0], observation)
        assert again[1] == reward


def test_the_reward_is_equation_20() -> None:
    env = BicycleEnv("random-start-random-goal")
    env.reset(seed=4)
    _, reward, _, _, info = env.step(np.array([1.0, -1.0], np.float32))
    _, _, lean, rate, acceleration, error = env.task.observation()[0]
    expected = -(lean**2 + 0.1 * rate**2 + 0.01 * acceleration**2 + 2.0 * error**2)
    assert reward == pytest.approx(expected)
    terms = [value for name, value in info.items() if name.startswith("reward_")]
    assert sum(terms) == pytest.approx(expected)
    assert len(terms) == 4


def test_next_step_autoreset() -> None:
    envs = BicycleVectorEnv(2, replace(NEAR, goal=Region((0.0, 1.4), (0.0, 30.0))))
    envs.reset(seed=6)
    zero = np.zeros(2)
    every = np.ones(2, dtype=bool)
    envs.task.place(every, zero, zero, zero, zero, np.array([1.4, 30.0]))
    still = np.zeros((2, 2), np.float32)
    for _ in range(6):
        observation, reward, terminated, truncated, _ = envs.step(still)
    assert terminated.tolist() == [True, False]
    last = observation[1].copy()
    observation, reward, terminated, truncated, info = envs.step(np.ones((2, 2), np.float32))
    assert terminated.tolist() == truncated.tolist() == [False, False]
    assert reward[0] == 0.0
    assert reward[1] != 0.0
    np.testing.assert_array_equal(observation[0], [0.0] * 6)
    assert not np.array_equal(observation[1], last)
    assert envs.task.steps.tolist() == [0, 7]
    assert info["reward_lean_angle"][0] == 0.0


def test_a_seed_repeats_a_ride() -> None:
    def ride(seed: int) -> list[np.ndarray]:
        envs = BicycleVectorEnv(4, replace(NEAR, goal=Region((-9.0, 3.0), (9.0, 9.0))))
        found = [envs.reset(seed=seed)[0]]
        envs.action_space.seed(seed)
        found += [envs.step(envs.action_space.sample())[0] for _ in range(70)]
        return found

    np.testing.assert_array_equal(ride(1), ride(1))
    assert not np.array_equal(ride(1), ride(2))


def test_observations_stay_inside_however_wild() -> None:
    env = BicycleEnv(observation_scale=AUTHORS_SCALE)
    env.reset(seed=0)
    for value in (1e6, -1e6):
        env.task.state = replace(env.task.state, steer_rate=np.array([value]))
        assert env.step(np.zeros(2, np.float32))[0] in env.observation_space


@pytest.mark.parametrize(
    ("kwargs", "words"),
    [
        ({"scenario": "learnt-speed"}, "did you mean 'learned-speed'"),
        ({"physics": "true"}, "choose faithful or corrected"),
        ({"fall": "stop"}, "fall must be one of freeze, terminate"),
        ({"observation_scale": (1.0, 2.0)}, "six numbers above zero"),
        ({"observation_scale": (1.0,) * 5 + (0.0,)}, "six numbers above zero"),
        ({"render_mode": "ansi"}, "render_mode must be None or rgb_array or human, not 'ansi'"),
        ({"variant": "train"}, "did you mean 'training'"),
        ({"observation_scale": "raw"}, "must be 'natural' or 'authors', or six numbers"),
        ({"discount": 1.0}, "discount must lie in 0..1"),
        (
            {"scenario": replace(FAR, torque_limit=0.0, displacement_limit=0.0)},
            "allows no action at all",
        ),
    ],
)
def test_mistakes_are_one_line(kwargs: dict[str, Any], words: str) -> None:
    for kind in (BicycleEnv, BicycleVectorEnv):
        with pytest.raises(ValueError, match=words) as caught:
            kind(**kwargs)
        assert "\n" not in str(caught.value)


def test_an_action_that_is_not_finite_is_refused() -> None:
    env = BicycleEnv(named("learned-speed"))
    env.reset(seed=0)
    with pytest.raises(ValueError, match="not finite"):
        env.step(np.array([np.nan, 0.0, 0.0]))


def test_the_docstring_states_the_spaces() -> None:
    space = BicycleEnv().observation_space
    assert isinstance(space, Box)
    rows = re.findall(r"\| +(-?[\w./]+) +\| +([\w./]+) +\| rad", BicycleEnv.__doc__ or "")
    low, high = zip(*rows, strict=True)
    known = {"pi": math.pi, "-pi": -math.pi, "pi/2": math.pi / 2, "-pi/2": -math.pi / 2}
    np.testing.assert_allclose(space.low, [known.get(text) or float(text) for text in low])
    np.testing.assert_allclose(space.high, [known.get(text) or float(text) for text in high])


def test_every_scenario_has_an_id_of_its_own() -> None:
    for name in SCENARIOS:
        env = gymnasium.make(f"bicycle/{name}-v0")
        assert env.unwrapped.task.scenario == SCENARIOS[name]
        assert env.spec.max_episode_steps == SCENARIOS[name].max_steps
        assert env.spec.reward_threshold == REWARD_THRESHOLDS[name]
        train = gymnasium.make(f"bicycle/{name}-train-v0")
        assert train.unwrapped.task.scenario.max_steps == train.spec.max_episode_steps <= 600


def test_the_step_limit_is_that_of_the_scenario_ridden() -> None:
    env = gymnasium.make("bicycle_sim:BicycleGoal-v0", scenario=NEAR)
    assert env.spec.max_episode_steps == 30
    assert gymnasium.make("BicycleGoal-v0", max_episode_steps=7).spec.max_episode_steps == 7
    many = gymnasium.make_vec("bicycle/learned-speed-v0", num_envs=2)
    assert many.scenario == SCENARIOS["learned-speed"]


def test_a_picture_shows_the_bicycle() -> None:
    env = gymnasium.make("bicycle_sim:BicycleGoal-v0", render_mode="rgb_array")
    env.reset(seed=3)
    upright = env.render()
    assert upright.shape == (480, 640, 3)
    assert upright.dtype == np.uint8
    assert np.array_equal(upright, env.render())
    task = env.unwrapped.task
    task.state = replace(task.state, lean_angle=np.array([0.5]))
    leaning = env.render()
    middle = np.any(leaning != upright, axis=-1)
    assert middle[150:350, 200:450].mean() > 0.05, "the rider leans"
    assert np.argwhere(frame(leaning))[:, 1].mean() < np.argwhere(frame(upright))[:, 1].mean(), (
        "to the left"
    )


def test_the_legs_pedal_by_the_way_that_was_ridden() -> None:
    scene = Scene((0.0, 0.0), (1.11, 0.0), 0.0, 0.0, 2.0, (20.0, 3.0), 1.0, 0.34, fallen=False)
    standing, riding = Renderer(), Renderer(way=0.34 * np.pi)  # a quarter turn of the crank
    one, other = standing.draw(scene), riding.draw(scene)
    changed = np.any(one != other, axis=-1)
    rows, columns = np.nonzero(changed)
    assert changed.mean() > 0.004
    assert rows.min() > 180, "only below the hips"
    assert np.ptp(columns) < 200, "only at the bicycle"


def frame(picture: np.ndarray) -> np.ndarray:
    """Return the place of the bicycle's frame."""
    return (picture[:, :, 0] > 150) & (picture[:, :, 1] < 90)


def test_many_bicycles_have_a_picture_each() -> None:
    envs = gymnasium.make_vec("BicycleGoal-v0", num_envs=2, render_mode="rgb_array")
    envs.reset(seed=1)
    first, second = envs.render()
    assert first.shape == second.shape == (480, 640, 3)
    assert BicycleVectorEnv(num_envs=2).render() is None


def test_success_is_told_where_the_goal_is_reached() -> None:
    env = BicycleEnv(NEAR)
    _, info = env.reset(seed=0)
    successes = [info["is_success"]]
    ended = False
    while not ended:
        _, _, ended, _, info = env.step(np.zeros(2, np.float32))
        successes.append(info["is_success"])
    assert successes == [False] * (len(successes) - 1) + [True]


@pytest.mark.parametrize(
    "first",
    [
        "import bicycle_sim, gymnasium",
        "import gymnasium, bicycle_sim",
        "import gymnasium",
        "import bicycle_sim, importlib.util as u; u.find_spec('gymnasium'); import gymnasium",
    ],
)
def test_make_works_in_whatever_order_packages_are_imported(first: str) -> None:
    make = "print(gymnasium.make('bicycle_sim:BicycleGoal-v0').spec.id)"
    done = subprocess.run(
        [sys.executable, "-c", f"{first}; {make}"], capture_output=True, text=True
    )
    assert done.stdout == "BicycleGoal-v0\n", done.stderr


def test_the_package_loads_gymnasium_for_nobody_else() -> None:
    """Nodes import this package, and Gymnasium takes a third of a second."""
    words = "import sys, bicycle_sim; print('gymnasium' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True)
    assert done.stdout == "False\n", done.stderr
