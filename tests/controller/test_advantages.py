import numpy as np
import pytest

from bicycle_controller.data.rollout_buffer import advantages


def test_advantages_by_hand() -> None:
    # gamma 0.5, lambda 0.5, one bicycle: step 1 goes on, step 2 runs out of time, step 3 goes on,
    # step 4 falls. Differences: -1 + 0.5 * -4 + 2 = -1; -1 + 0.5 * -8 + 4 = -1, where the value
    # -8 of the state at the time-out counts; -2 + 0.5 * -6 + 3 = -2; -10 + 6 = -4 without a
    # value, whatever it is.
    reward = np.array([[-1.0], [-1.0], [-2.0], [-10.0]])
    value = np.array([[-2.0], [-4.0], [-3.0], [-6.0]])
    next_value = np.array([[-4.0], [-8.0], [-6.0], [99.0]])
    discount = np.array([[0.5], [0.5], [0.5], [0.0]])
    ended = np.array([[False], [True], [False], [True]])
    found = advantages(reward, value, next_value, discount, ended, 0.5)
    # The second episode never reaches back into the first: -1 + 0.25 * -1, -1, -2 + 0.25 * -4, -4.
    assert found[:, 0].tolist() == [-1.25, -1.0, -3.0, -4.0]


def test_the_rollouts_end_bootstraps_and_bicycles_do_not_mix() -> None:
    reward = np.array([[-1.0, 0.0], [-1.0, 0.0]])
    value = np.zeros((2, 2))
    next_value = np.array([[0.0, 0.0], [-4.0, 0.0]])
    discount, ended = np.full((2, 2), 0.5), np.zeros((2, 2), dtype=bool)
    found = advantages(reward, value, next_value, discount, ended, 1.0)
    # -1 + 0.5 (-1 + 0.5 * -4), and -1 + 0.5 * -4.
    assert found.tolist() == [[-2.5, 0.0], [-3.0, 0.0]]


def test_lambda_one_is_the_discounted_return_and_zero_one_step() -> None:
    rng = np.random.default_rng(0)
    reward, value = rng.normal(size=(50, 3)), rng.normal(size=(51, 3))
    discount, ended = np.full((50, 3), 0.9), np.zeros((50, 3), dtype=bool)
    arguments = (reward, value[:-1], value[1:], discount, ended)
    powers = 0.9 ** np.arange(50)[:, None]
    expected = (powers * reward).sum(0) + 0.9**50 * value[-1] - value[0]
    assert advantages(*arguments, 1.0)[0] == pytest.approx(expected)
    one_step = reward + 0.9 * value[1:] - value[:-1]
    assert advantages(*arguments, 0.0) == pytest.approx(one_step)
