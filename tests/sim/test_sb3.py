"""stable-baselines3 itself on the bicycle: its checker, its own vector environments, and ours."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

stable_baselines3 = pytest.importorskip("stable_baselines3")

import gymnasium  # noqa: E402
from stable_baselines3 import PPO, SAC, TD3  # noqa: E402
from stable_baselines3.common.callbacks import EvalCallback  # noqa: E402
from stable_baselines3.common.env_checker import check_env  # noqa: E402
from stable_baselines3.common.env_util import make_vec_env  # noqa: E402
from stable_baselines3.common.evaluation import evaluate_policy  # noqa: E402
from stable_baselines3.common.vec_env import VecNormalize  # noqa: E402

from bicycle_sim.task import registration  # noqa: E402
from bicycle_sim.task.sb3 import BicycleVecEnv  # noqa: E402

registration.register()  # whatever imported the package first

ID = "bicycle/random-start-random-goal-v0"
TRAIN = "bicycle/random-start-random-goal-train-v0"


def small() -> dict[str, Any]:
    """Arguments of a learner; some change the inner mapping."""
    return {"policy_kwargs": {"net_arch": [8]}, "device": "cpu", "seed": 1}


@pytest.mark.parametrize("name", [ID, TRAIN, "bicycle/learned-speed-train-v0"])
def test_its_checker_is_content(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(name).unwrapped)


def test_the_two_commonest_lines() -> None:
    SAC("MlpPolicy", f"bicycle_sim:{TRAIN}", **small(), learning_starts=50).learn(60)
    envs = make_vec_env(f"bicycle_sim:{ID}", n_envs=4)
    assert envs.reset().shape == (4, 6)


def test_the_fast_environment_gives_what_its_own_gives() -> None:
    keywords = {"max_episode_steps": 30, "observation_scale": "natural"}
    ours = BicycleVecEnv(TRAIN, 3, **keywords)
    theirs = make_vec_env(TRAIN, n_envs=3, env_kwargs=keywords)
    for env in (ours, theirs):
        env.seed(11)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    assert ours.reset_infos == theirs.reset_infos
    rng, ends = np.random.default_rng(3), 0
    for _ in range(100):
        action = rng.uniform(-1, 1, (3, 2)).astype(np.float32)
        one, other = ours.step(action), theirs.step(action)
        for left, right in zip(one[:3], other[:3], strict=True):
            np.testing.assert_array_equal(left, right)
        for index in np.flatnonzero(one[2]):
            mine, monitors = one[3][index], other[3][index]
            ends += 1
            np.testing.assert_array_equal(
                mine.pop("terminal_observation"), monitors.pop("terminal_observation")
            )
            mine["episode"].pop("t"), monitors["episode"].pop("t")
            assert mine == monitors
    assert ends >= 9


def test_its_tools_work_on_it(tmp_path: Path) -> None:
    train = VecNormalize(BicycleVecEnv(TRAIN, 8, max_episode_steps=40))
    held = VecNormalize(BicycleVecEnv(ID, 4, max_episode_steps=40), training=False)
    callback = EvalCallback(
        held, n_eval_episodes=4, eval_freq=20, best_model_save_path=str(tmp_path), verbose=0
    )
    model = PPO("MlpPolicy", train, n_steps=32, batch_size=64, n_epochs=1, **small())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.learn(512, callback=callback)
        returns, lengths = evaluate_policy(
            model, held, n_eval_episodes=6, return_episode_rewards=True
        )
    assert (tmp_path / "best_model.zip").exists()
    assert len(model.ep_info_buffer) > 0
    assert len(returns) == 6
    assert max(lengths) <= 40
    assert callback.evaluations_results == [] or np.isfinite(callback.last_mean_reward)


def test_an_off_policy_learner_learns_from_it() -> None:
    env = BicycleVecEnv(TRAIN, 16, observation_scale="natural")
    model = TD3("MlpPolicy", env, train_freq=1, gradient_steps=1, learning_starts=160, **small())
    model.learn(800)
    assert model.num_timesteps == 800
    assert np.isfinite(model.replay_buffer.rewards).all()
    timed_out = model.replay_buffer.timeouts[: model.replay_buffer.pos]
    assert timed_out.sum() <= model.replay_buffer.dones.sum()


def test_attributes_methods_options_and_pictures() -> None:
    env = BicycleVecEnv(ID, 3, render_mode="rgb_array")
    env.set_options([{"goal": (float(index), 0.0)} for index in range(3)])
    env.seed(1)
    env.reset()
    assert env.get_attr("goal", indices=[0, 2]) == [(0.0, 0.0), (2.0, 0.0)]
    env.set_attr("goal", (5.0, 5.0), indices=1)
    assert env.get_attr("goal") == [(0.0, 0.0), (5.0, 5.0), (2.0, 0.0)]
    assert env.env_method("action_names", indices=0) == [("torque", "displacement")]
    assert env.render().ndim == 3
    env.set_options([{"goal": (1.0, 0.0)}, {}, {}])
    with pytest.raises(ValueError, match="the same options for every bicycle"):
        env.reset()
    env.close()


def test_another_id_is_one_line() -> None:
    with pytest.raises(ValueError, match="not 'Pendulum-v1'") as caught:
        BicycleVecEnv("Pendulum-v1")
    assert "\n" not in str(caught.value)


def test_record_video_writes_a_film(tmp_path: Path) -> None:
    env = gymnasium.make(TRAIN, render_mode="rgb_array", max_episode_steps=5)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        film = gymnasium.wrappers.RecordVideo(env, str(tmp_path))
    film.reset(seed=1)
    for _ in range(5):
        film.step(np.zeros(2, np.float32))
    film.close()  # type: ignore[no-untyped-call]
    (result,) = tmp_path.glob("*.mp4")
    assert result.stat().st_size > 1000
