"""The forward pass for one bicycle: in C++, and in numpy where that was not built."""

import math
import pickle

import numpy as np
import pytest
from policies import make_policy

from bicycle_common import native_library
from bicycle_controller.policy import inference
from bicycle_controller.policy.inference import NativeForward, NumpyForward
from bicycle_controller.policy.policy import Policy

KINDS = {NativeForward: inference.load, NumpyForward: lambda: None}


@pytest.fixture(params=KINDS, ids=lambda kind: kind.__name__)
def kind(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> type:
    monkeypatch.setattr(inference, "load", KINDS[request.param])
    return request.param


def random_policy(kind: type, seed: int, norm: bool, halves: str = "no") -> Policy:
    """Return a policy of two hidden layers, whose second may be two halves."""
    drawn = make_policy(seed, (32, 24), norm=norm)
    weight = drawn.tensors["layer.1.weight"]
    if halves != "no":
        weight[:12, 16:] = weight[12:, :16] = 0.0
    if halves == "alike":
        weight[12:, 16:] = weight[:12, :16]
    policy = Policy(drawn.info, drawn.tensors)
    assert type(policy._one) is kind
    return policy


def test_set_up_has_built_it() -> None:
    assert inference.load() is not None


@pytest.mark.parametrize("norm", [False, True])
@pytest.mark.parametrize("halves", ["no", "different", "alike"])
def test_one_is_a_row_of_many(kind: type, halves: str, norm: bool) -> None:
    policy = random_policy(kind, 5, norm, halves)
    observations = np.random.default_rng(6).normal(size=(50, 6))
    rows = [policy.act(one[None])[0] for one in observations]
    np.testing.assert_allclose(rows, policy.act(observations), rtol=0, atol=1e-6)


def test_halves_leave_their_zeros_out() -> None:
    for halves, blocks, share in (("no", 1, False), ("different", 2, False), ("alike", 2, True)):
        forward = random_policy(NativeForward, 5, False, halves)._one
        assert isinstance(forward, NativeForward)
        weights = forward._keep[0][1]
        assert len(weights) == blocks
        assert (weights[0] is weights[-1] and blocks == 2) == share


@pytest.mark.parametrize("norm", [False, True])
def test_it_sums_in_the_order_of_the_inputs(norm: bool) -> None:
    """Each product and each sum rounded to single precision: any processor gives these bits."""
    policy = random_policy(NativeForward, 7, norm)
    f = np.float32
    epsilon = f(1e-5)
    for observation in np.random.default_rng(8).normal(size=(20, 6)):
        values = observation.astype(f)
        for index, layer in enumerate(policy._layers):
            weight = layer[0].astype(float) / policy._scale[:, 0] if index == 0 else layer[0]
            total = layer[1][:, 0].copy()
            for column, value in zip(weight.astype(f).T, values, strict=True):
                total += column * value
            values = total
            if index == len(policy._layers) - 1:
                break
            if norm:
                squares = f(0)
                for value in values:
                    squares = f(squares + value * value)
                share = f(1) / np.sqrt(squares / f(len(values)) + epsilon)
                values = values * (share * layer[2][:, 0]) + layer[3][:, 0]
            values = np.maximum(values, f(0))
        expected = [
            limit * math.tanh(value) for limit, value in zip(policy._limits, values, strict=True)
        ]
        assert policy.act(observation[None])[0].tolist() == expected


def test_answers_are_not_overwritten_by_the_next(kind: type) -> None:
    policy = random_policy(kind, 1, False)
    first = policy.act(np.zeros((1, 6)))
    kept = first.copy()
    policy.act(np.ones((1, 6)))
    assert (first == kept).all()


def test_a_policy_can_be_sent_to_another_process(kind: type) -> None:
    policy = random_policy(kind, 4, True, "alike")
    copy = pickle.loads(pickle.dumps(policy))
    observation = np.ones((1, 6))
    assert copy.policy_id == policy.policy_id
    assert copy.act(observation).tolist() == policy.act(observation).tolist()


@pytest.mark.parametrize("norm", [False, True])
def test_nan_is_not_hidden(kind: type, norm: bool) -> None:
    policy = random_policy(kind, 2, norm)
    for place in range(6):
        observation = np.zeros((1, 6))
        observation[0, place] = np.nan
        assert np.isnan(policy.act(observation)[0, :2]).all()


def test_single_precision_strides_and_order_do_not_matter(kind: type) -> None:
    policy = random_policy(kind, 3, False)
    whole = np.random.default_rng(9).normal(size=(12, 12)).astype(np.float32)
    plain = policy.act(np.ascontiguousarray(whole[:1, ::2]).astype(np.float64))
    np.testing.assert_array_equal(policy.act(whole[:1, ::2]), plain)
    np.testing.assert_array_equal(policy.act(whole[:1, ::2].astype(np.float64, "F")), plain)


def test_without_the_library_it_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inference, "load", lambda: None)
    with pytest.raises(RuntimeError, match=r"setup\.sh"):
        NativeForward([], np.ones(3), 1e-5)


@pytest.mark.parametrize("name", ["not-there", "../models/fixed-speed"])
def test_no_library_where_none_loads(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setattr(inference, "LIBRARY", name)
    monkeypatch.setattr(native_library, "EXTENSION_SUFFIXES", [".safetensors"])
    assert inference.load.__wrapped__() is None
