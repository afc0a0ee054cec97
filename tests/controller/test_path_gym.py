"""Following a path in Gymnasium: its checker, ends, and the classical follower as an agent."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from bicycle_controller.training.path_task import FALL, LONGEST  # noqa: E402

ID = "bicycle_controller.training.path_gym:bicycle/follow-path-v0"


@pytest.mark.parametrize("words", [{"roads": 3}, {"roads": 2, "plant": "choi"}])
def test_passes_gymnasiums_checker_without_warnings(words: dict[str, object]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(ID, **words)
        check_env(env.unwrapped)
        env.close()


def test_the_teachers_torque_stays_on_the_road() -> None:
    env = gymnasium.make(ID, roads=5)
    _, info = env.reset(seed=1)
    off, lost, over = [], False, False
    while not (lost or over):
        off.append(abs(info["cross_track"]))
        action = np.array([info["teacher"]], dtype=np.float32)
        _, reward, lost, over, info = env.step(action)
        assert reward < 0.0
    assert not lost
    assert len(off) <= LONGEST
    assert max(off[-100:]) < 0.2 < off[0]
    env.close()


def test_full_torque_loses_the_road() -> None:
    env = gymnasium.make(ID, roads=5)
    env.reset(seed=1)
    lost = over = False
    while not (lost or over):
        _, reward, lost, over, _ = env.step(np.array([1.0], dtype=np.float32))
    assert lost
    assert reward < -FALL
    env.close()


def test_a_bad_action_is_refused() -> None:
    env = gymnasium.make(ID, roads=1).unwrapped
    env.reset(seed=1)
    with pytest.raises(ValueError, match="give one finite number"):
        env.step(np.array([np.nan]))
