import math
import subprocess
import sys

import numpy as np
import pytest
from policies import make_policy

from bicycle_controller.policy.policy import CHUNK, Policy, PolicyInfo
from bicycle_controller.policy.torch_policy import TorchPolicy
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import SCENARIOS

SCENARIO = SCENARIOS["fixed-start-fixed-goal"]


def small(norm: bool, limits: tuple[float, ...] = (2.0, 0.0, 100.0)) -> Policy:
    """Two hidden units that see the steering angle as 3 x and 1 x, and two outputs."""
    tensors = {
        "layer.0.weight": np.array([[3, 0, 0, 0, 0, 0], [1, 0, 0, 0, 0, 0]], np.float32),
        "layer.0.bias": np.array([0.0, 0.0], np.float32),
        "layer.1.weight": np.array([[0.5, -0.25], [-0.5, 1.0]], np.float32),
        "layer.1.bias": np.array([0.1, 0.0], np.float32),
    }
    if norm:
        tensors["norm.0.weight"] = np.array([2.0, 1.0], np.float32)
        tensors["norm.0.bias"] = np.array([0.5, 0.25], np.float32)
    info = PolicyInfo("small", SCENARIO, ChoiPlant(), (0.5, 1, 1, 1, 1, 1), limits)
    return Policy(info, tensors)


def steered(angle: float) -> np.ndarray:
    return np.array([[angle, 0.0, 0.0, 0.0, 0.0, 0.0]])


def test_network_worked_by_hand() -> None:
    # 0.4 / 0.5 = 0.8; hidden 2.4, 0.8; sums 0.5*2.4 - 0.25*0.8 + 0.1 = 1.1, -1.2 + 0.8 = -0.4.
    action = small(norm=False).act(steered(0.4))
    expected = [[2.0 * math.tanh(1.1), 0.0, 100.0 * math.tanh(-0.4)]]
    np.testing.assert_allclose(action, expected, rtol=1e-6)
    # To the other side relu closes both units: only the bias is left.
    action = small(norm=False).act(steered(-0.4))
    np.testing.assert_allclose(action, [[2.0 * math.tanh(0.1), 0.0, 0.0]], rtol=1e-6)


def test_layer_norm_worked_by_hand() -> None:
    # Sums 3 and 1: mean 2, variance 1, so +-1 / sqrt(1 + 1e-5); then 2 n + 0.5 and n + 0.25.
    one = 1.0 / math.sqrt(1.0 + 1e-5)
    first = 2.0 * one + 0.5
    action = small(norm=True).act(steered(0.5))
    expected = [[2.0 * math.tanh(0.5 * first + 0.1), 0.0, 100.0 * math.tanh(-0.5 * first)]]
    np.testing.assert_allclose(action, expected, rtol=1e-6)


@pytest.mark.parametrize("norm", [False, True])
@pytest.mark.parametrize("limits", [(2.0, 0.2, 0.0), (2.0, 0.02, 100.0), (0.0, 0.0, 50.0)])
def test_equals_torch(norm: bool, limits: tuple[float, float, float]) -> None:
    policy = make_policy(hidden=(400, 300), limits=limits, norm=norm)
    observation = np.random.default_rng(1).normal(size=(CHUNK * 2 + 7, 6))
    difference = policy.act(observation) - TorchPolicy(policy).act(observation)
    assert np.abs(difference / np.maximum(limits, 1e-9)).max() < 1e-5
    largest = np.abs(policy.act(observation)).max(axis=0)
    assert (largest <= limits).all()
    assert (largest >= 0.1 * np.array(limits)).all()


@pytest.mark.parametrize("norm", [False, True])
def test_a_batch_is_its_rows(norm: bool) -> None:
    policy = make_policy(norm=norm)
    observation = np.random.default_rng(2).normal(size=(CHUNK + 3, 6))
    batch = policy.act(observation)
    singles = np.concatenate([policy.act(row[None]) for row in observation])
    np.testing.assert_allclose(batch, singles, atol=1e-6)


def test_no_bicycles_no_actions() -> None:
    assert make_policy().act(np.zeros((0, 6))).shape == (0, 3)


def test_nan_is_not_hidden() -> None:
    action = make_policy().act(np.full((1, 6), np.nan))
    assert np.isnan(action[0, :2]).all()


@pytest.mark.parametrize("shape", [(6,), (1, 5), (2, 3, 6)])
def test_wrong_observation_shape(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="must have shape"):
        make_policy().act(np.zeros(shape))


def test_speed_is_ignored() -> None:
    policy, observation = make_policy(), np.ones((4, 6))
    np.testing.assert_array_equal(policy.act(observation, np.ones(4)), policy.act(observation))


def test_needs_no_torch_scipy_or_ros() -> None:
    code = (
        "import sys, bicycle_controller.policy.policy;"
        "print([m for m in ('torch', 'scipy', 'rclpy', 'onnx', 'gymnasium') if m in sys.modules])"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert found.stdout.strip() == "[]"
