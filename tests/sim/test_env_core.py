"""Common part of both environments: equal bits of every way to step, variants, options, ends."""

from __future__ import annotations

import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bicycle_sim.plants.choi.parameters import Physics
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import SCENARIOS, Region, named

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.spaces import Box  # noqa: E402
from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.vector import AutoresetMode, SyncVectorEnv  # noqa: E402
from gymnasium.wrappers import RecordEpisodeStatistics  # noqa: E402

from bicycle_sim.task.gym_env import BicycleEnv, BicycleVectorEnv  # noqa: E402
from bicycle_sim.task.training_variant import TrainingVariant  # noqa: E402

SHORT = replace(
    named("learned-speed"),
    max_steps=40,
    goal=Region((90.0, 90.0), (110.0, 110.0)),
    goal_radius=9.0,
)
KINDS: dict[str, dict[str, Any]] = {
    "evaluation": {"scenario": replace(SHORT, start=Region((90.0, 90.0), (110.0, 110.0)))},
    "training": {"scenario": SHORT, "variant": "training", "observation_scale": "natural"},
    "noisy": {"scenario": SHORT, "plant": ChoiPlant(Physics(displacement_noise=0.02))},
    "value": {"scenario": "random-start-random-goal", "fall": "value", "max_episode_steps": 50},
    "whipple": {"scenario": SHORT, "plant": "whipple", "variant": "training"},
}


def actions(count: int, width: int, steps: int) -> Iterator[np.ndarray]:
    """Hard ones and gentle ones, some beyond 1, float32 as agents give them."""
    rng = np.random.default_rng(5)
    for _ in range(steps):
        scale = rng.choice([0.1, 1.0, 3.0], size=(count, 1))
        yield (rng.normal(size=(count, width)) * scale).astype(np.float32)


def same(one: Any, many: Any, index: int) -> None:
    """Hold what the single environment gave against one row of the vector environment's."""
    assert one[0].dtype == many[0].dtype
    assert one[0].tobytes() == many[0][index].tobytes()
    assert one[1:4] == tuple(values[index] for values in many[1:4])
    assert one[4] == {name: many[4][name][index] for name in one[4]}


@pytest.mark.parametrize("kind", KINDS)
def test_bicycle_i_of_n_is_the_single_one_with_seed_i(kind: str) -> None:
    count, first = 5, 30
    many = BicycleVectorEnv(count, **KINDS[kind])
    single = [BicycleEnv(**KINDS[kind]) for _ in range(count)]
    begun, info = many.reset(seed=first)
    for index, env in enumerate(single):
        observation, own = env.reset(seed=first + index)
        same((observation, 0, 0, 0, own), (begun, *np.zeros((3, count)), info), index)
    ended = [False] * count
    episodes = 0
    for action in actions(count, len(many.action_names), 130):
        found = many.step(action)
        for index, env in enumerate(single):
            if ended[index]:  # next-step autoreset
                observation, own = env.reset()
                same((observation, 0.0, False, False, own), found, index)
                ended[index], episodes = False, episodes + 1
            else:
                one = env.step(action[index])
                same(one, found, index)
                ended[index] = one[2] or one[3]
    assert episodes >= 5


@pytest.mark.parametrize("kind", ["evaluation", "training", "noisy", "value"])
def test_the_compiled_step_gives_the_bits_of_numpy(kind: str) -> None:
    quick, plain = (BicycleEnv(**KINDS[kind]) for _ in "12")
    assert quick._core.compiled, "set-up has built it"
    plain._core.compiled, plain.task._native = False, None
    for env in (quick, plain):
        env.reset(seed=3)
    for action in actions(1, len(quick.action_names), 200):
        one, other = quick.step(action[0]), plain.step(action[0])
        assert one[0].tobytes() == other[0].tobytes()
        assert one[1:] == other[1:]
        assert [type(value) for value in one[4].values()] == [
            type(value) for value in other[4].values()
        ]
        if one[2] or one[3]:
            for env in (quick, plain):
                env.reset()


def test_a_state_that_is_written_is_ridden_on() -> None:
    env = BicycleEnv()
    env.reset(seed=1)
    still = np.zeros(2, np.float32)
    before = env.task.state
    env.step(still)
    assert before.rear_x != env.task.state.rear_x, "what was read does not change"
    env.task.state = replace(env.task.state, lean_angle=np.array([0.3]))
    assert env.step(still)[0][2] == pytest.approx(0.3, abs=0.02)
    env.task.step(np.zeros((1, 3)))
    env.goal = (1.0, 2.0)
    assert env.step(still)[4]["episode_length"] == 4
    assert env.goal == (1.0, 2.0)


@pytest.mark.parametrize("name", SCENARIOS)
def test_no_ride_comes_near_the_bounds(name: str) -> None:
    for plant in ("choi", "whipple"):
        envs = BicycleVectorEnv(64, name, plant=plant, variant="training")
        envs.reset(seed=1)
        space, worst = envs.single_observation_space, np.zeros(6)
        assert isinstance(space, Box)
        high = space.high
        rng = np.random.default_rng(2)
        held = rng.choice([-1.0, 1.0], (64, len(envs.action_names)))
        for step in range(150):
            flip = rng.random(held.shape) < np.where(np.arange(64) < 32, 0.02, 0.3)[:, None]
            held = np.where(flip, -held, held)
            balance = -np.sign(envs.task.state.lean_angle)
            if "displacement" in envs.action_names and step % 3:
                held[::2, 1] = balance[::2]
            worst = np.maximum(worst, np.abs(envs.step(held.astype("f4"))[0]).max(axis=0))
        assert (worst[1:5] < 0.7 * high[1:5]).all(), (plant, worst)


def test_training_rewards_and_falls() -> None:
    plain = BicycleEnv()
    training = BicycleEnv(variant="training")
    where = {"start": (0.0, 0.0), "heading": 0.0, "goal": (0.0, -50.0)}  # behind: costs 2 pi^2
    for env in (plain, training):
        env.reset(seed=0, options=where)
        env.task.state = plain.task.state
    still = np.zeros(2, np.float32)
    assert plain.step(still)[1] == pytest.approx(-2 * np.pi**2)
    assert training.step(still)[1] == -4.0 * 0.05
    training.task.state = replace(training.task.state, lean_angle=np.array([0.6]))
    _, reward, terminated, _, info = training.step(still)
    assert terminated
    assert info["fallen"]
    assert reward == pytest.approx(-4.0 * 0.05 / 0.01)
    assert info["episode_return"] == pytest.approx(-0.2 + reward)


def test_training_starts() -> None:
    envs = BicycleVectorEnv(400, "learned-speed", variant="training")
    _, info = envs.reset(seed=0)
    state, variant = envs.task.state, TrainingVariant()
    near = info["goal_distance"] <= variant.near_distance[1]
    assert 0.45 < near.mean() < 0.65
    assert np.abs(state.lean_angle).max() == pytest.approx(variant.tilt, rel=0.05)
    assert np.abs(state.steer_rate).max() == pytest.approx(variant.steer_rate, rel=0.05)
    assert state.speed.min() < 1.2 < 4.8 < state.speed.max()
    assert envs.scenario.max_steps == 600
    assert gymnasium.make("bicycle/learning-to-turn-train-v0").spec.max_episode_steps == 500


def test_the_evaluation_variant_is_the_scenario_itself() -> None:
    env, same_env = BicycleEnv("learned-speed"), gymnasium.make("bicycle/learned-speed-v0")
    one, other = env.reset(seed=4)[0], same_env.reset(seed=4)[0]
    np.testing.assert_array_equal(one, other)
    assert env.task.state.lean_angle == 0
    assert env.scenario == named("learned-speed")


def test_reset_takes_start_heading_speed_and_goal() -> None:
    env = BicycleEnv("learned-speed")
    options = {"start": (1.0, 2.0), "heading": 0.5, "speed": 3.0, "goal": (4.0, 6.0)}
    _, info = env.reset(seed=0, options=options)
    state = env.task.state
    assert (state.rear_x, state.rear_y, state.speed) == (1.0, 2.0, 3.0)
    assert state.heading == pytest.approx(0.5)
    assert info["goal_distance"] == 5.0
    many = BicycleVectorEnv(3, "learned-speed")
    many.reset(seed=0, options={"goal": [(1.0, 1.0), (2.0, 2.0), (3.0, 3.0)], "speed": 2.0})
    assert many.get_attr("goal") == ((1.0, 1.0), (2.0, 2.0), (3.0, 3.0))
    alone = BicycleEnv("learned-speed")
    alone.reset(seed=1)
    np.testing.assert_array_equal(many.task.state.rear_x[1], alone.task.state.rear_x[0])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"goals": (1, 2)}, "unknown reset option 'goals' .did you mean 'goal'"),
        ({"goal": (1, 2, 3)}, "option goal must be 2 numbers"),
        ({"goal": "there"}, "option goal must be 2 numbers"),
        ({"heading": np.nan}, "option heading must be a number"),
        ({"speed": 9.0}, "within 1.0..5.0 m/s"),
        ({"reset_mask": [1, 2]}, "reset_mask"),
    ],
)
def test_wrong_options_are_one_line(options: dict[str, Any], words: str) -> None:
    for env in (BicycleEnv("learned-speed"), BicycleVectorEnv(3, "learned-speed")):
        with pytest.raises(ValueError, match=words.replace("..", r"\.\.")) as caught:
            env.reset(options=options)
        assert "\n" not in str(caught.value)


def test_seeds_may_be_a_list() -> None:
    envs = BicycleVectorEnv(3)
    listed = envs.reset(seed=[7, 8, 9])[0]
    assert envs.np_random_seed == (7, 8, 9)
    np.testing.assert_array_equal(listed, envs.reset(seed=7)[0])
    turned = envs.reset(seed=[9, None, 7])[0]
    np.testing.assert_array_equal(turned[[0, 2]], listed[[2, 0]])
    with pytest.raises(ValueError, match="3 of them, not 2"):
        envs.reset(seed=[1, 2])


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_autoreset_modes_do_as_gymnasiums_own_vector(mode: AutoresetMode) -> None:
    kind, count = KINDS["training"], 4
    ours = BicycleVectorEnv(count, **kind, autoreset_mode=mode.value)
    theirs = SyncVectorEnv([lambda: BicycleEnv(**kind)] * count, autoreset_mode=mode)
    assert ours.metadata["autoreset_mode"] is mode
    both = [ours, theirs]
    found = [env.reset(seed=9) for env in both]
    equal(*found)
    ends = 0
    for action in actions(count, 3, 120):
        steps = [env.step(action) for env in both]
        equal(*steps)
        ended = steps[0][2] | steps[0][3]
        ends += ended.sum()
        if mode is AutoresetMode.DISABLED and ended.any():
            with pytest.raises(ValueError, match="reset_mask"):
                ours.step(action)
            equal(*[env.reset(options={"reset_mask": ended.copy()}) for env in both])
    assert ends > 8


def equal(one: Any, other: Any) -> None:
    """Compare results of two vector environments, information and its masks included."""
    for left, right in zip(one[:-1], other[:-1], strict=True):
        np.testing.assert_array_equal(left, right)
    infos_equal(one[-1], other[-1])


def infos_equal(one: dict[str, Any], other: dict[str, Any]) -> None:
    assert set(one) == set(other)
    for name, value in one.items():
        if isinstance(value, dict):
            infos_equal(value, other[name])
            continue
        mask = value if name.startswith("_") else one[f"_{name}"]
        np.testing.assert_array_equal(mask, other[name if name[0] == "_" else f"_{name}"])
        for index in np.flatnonzero(mask):
            np.testing.assert_array_equal(value[index], other[name][index])


def test_attributes_and_calls() -> None:
    envs = BicycleVectorEnv(2, render_mode="rgb_array")
    envs.reset(seed=1)
    assert envs.get_attr("render_mode") == ("rgb_array",) * 2
    assert envs.get_attr("scenario") == (envs.scenario,) * 2
    assert envs.call("action_names") == (("torque", "displacement"),) * 2
    assert len(envs.call("render")) == 2
    envs.set_attr("goal", (3.0, 4.0))
    assert envs.get_attr("goal") == ((3.0, 4.0),) * 2
    with pytest.raises(ValueError, match="did you mean 'goal'"):
        envs.set_attr("goals", (3.0, 4.0))
    with pytest.raises(AttributeError):
        envs.get_attr("wheels")


def test_episode_statistics_are_gymnasiums() -> None:
    env = RecordEpisodeStatistics(gymnasium.make("bicycle/learned-speed-train-v0"))
    env.reset(seed=2)
    ended = False
    for action in actions(1, 3, 600):
        _, _, terminated, truncated, info = env.step(action[0])
        if terminated or truncated:
            ended = True
            break
    assert ended
    assert info["episode"]["r"] == pytest.approx(info["episode_return"])
    assert info["episode"]["l"] == info["episode_length"]


def test_both_checkers_are_content() -> None:
    check_env(gymnasium.make("bicycle/random-start-random-goal-train-v0").unwrapped)


def test_a_human_sees_pictures_in_a_browser(capsys: pytest.CaptureFixture[str]) -> None:
    env = gymnasium.make("BicycleGoal-v0", render_mode="human")
    env.reset(seed=1)
    for _ in range(3):
        env.step(np.zeros(2, np.float32))
    assert env.render() is None
    address = capsys.readouterr().out.split()[-1]
    page = urllib.request.urlopen(address, timeout=60).read().decode()
    assert 'src="pictures"' in page
    with urllib.request.urlopen(f"{address}pictures", timeout=60) as pictures:
        head = pictures.read(200)
    assert b"Content-Type: image/png" in head
    assert b"\x89PNG" in head
    env.close()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(address, timeout=5)
